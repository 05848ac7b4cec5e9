"""The command that derives labels from other thresholds."""

# ruff: noqa: PLC0415

from __future__ import annotations

from pathlib import Path

import click

from grasp_factory.cli.params import AS_JSON, STORE, print_json
from grasp_factory.core.serialization import from_plain, to_plain


@click.command()
@STORE
@click.option("--name", required=True, help="Of the new label column, labels/NAME.")
@click.option("--min-lift", type=float, help="Metres above the rest, at the end of the hold.")
@click.option("--min-shake", type=float, help="Level of the shake to survive; 0 for none.")
@click.option("--min-grip-force", type=float, help="Newtons of either pad, during the hold.")
@click.option("--max-slip-distance", type=float, help="Metres in the hand.")
@click.option("--max-slip-angle", type=float, help="Radians in the hand.")
@AS_JSON
def relabel(path: Path, name: str, as_json: bool, **thresholds: float | None) -> None:
    """Label a store anew, from other thresholds, without simulating.

    Thresholds that are not given are those the store at PATH was made with. Its own labels stay.
    """
    from grasp_factory.cli.curation_report import relabel_text
    from grasp_factory.core.config.sections import LabelConfig
    from grasp_factory.curation.relabel import relabel as run
    from grasp_factory.dataset.dataset import Dataset

    given = {key: value for key, value in thresholds.items() if value is not None}
    settings = to_plain(Dataset.open(path).config.label) | given
    result = run(path, name, from_plain(LabelConfig, settings))
    if as_json:
        print_json(result)
    else:
        click.echo(relabel_text(result))
