"""The command that derives labels from other thresholds: ``relabel``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from grasp_factory.cli.params import AS_JSON, STORE, Command, option
from grasp_factory.cli.printing import print_json, say
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.serialization import from_plain, to_plain

if TYPE_CHECKING:
    from grasp_factory.curation.relabel import Relabelled

F = TypeVar("F", bound=Callable[..., Any])


def _threshold_options(command: F) -> F:
    """Add an option for each threshold of a label."""
    for name, text in reversed(LabelConfig.condition_texts().items()):
        command = option(
            f"--{name.replace('_', '-')}",
            metavar="X",
            type=float,
            heading="Thresholds",
            help=f"Success requires that {text.format('X')}.",
        )(command)
    return command


@click.command(
    cls=Command,
    examples=(
        "grasp-factory relabel grasps.zarr --name strict --min-shake 0.5",
        "grasp-factory relabel grasps.zarr --name gentle --max-slip-distance 0.005",
    ),
)
@STORE
@option("--name", metavar="NAME", required=True, help="Name of the new column, labels/NAME.")
@_threshold_options
@AS_JSON
def relabel(path: Path, name: str, as_json: bool, **thresholds: float | None) -> None:
    """Label the episodes of a store with other thresholds.

    Computes success from the recorded signals and adds it to the store at PATH as labels/NAME,
    without simulating. Thresholds default to those of the store's config. Existing labels stay.
    """
    from grasp_factory.curation.relabel import relabel as run
    from grasp_factory.dataset.dataset import Dataset

    given = {key: value for key, value in thresholds.items() if value is not None}
    settings = to_plain(Dataset(path).config.label) | given
    result = run(path, name, from_plain(LabelConfig, settings))
    if as_json:
        print_json(result)
    else:
        say(_text(result))


def _text(result: Relabelled) -> str:
    from grasp_factory.core.text_format import count

    return (
        f"labels/{result.name}: {result.successes} successes of"
        f" {count(result.episodes, 'episode')} ({result.successes_before} by the store's own"
        f" label), {count(result.changed, 'outcome')} changed"
    )
