"""The options that choose rows of a store: ``--episodes``, ``--ids`` and ``--where``."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

import click

from grasp_factory.cli.params import IDS, indices
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import UsageError, lookup, shown

if TYPE_CHECKING:
    from grasp_factory.dataset.dataset import Dataset

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS = (
    click.option("--episodes", metavar="I,J,...", help="These rows."),
    IDS,
    click.option(
        "--where",
        metavar="COLUMN=VALUE",
        multiple=True,
        help="Episodes with this value, or one of a list, as in policy=[top_down,uniform]."
        " Repeatable.",
    ),
)


def row_options(command: F) -> F:
    """Add the options to a command; it hands them to ``chosen_rows`` as they come."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def chosen_rows(
    dataset: Dataset, *, episodes: str | None, ids: TextIO | None, where: tuple[str, ...]
) -> list[int] | None:
    """Return the rows that every option names, in the first one's order; None without options.

    Raises:
        UsageError: for a text that is not valid, or a list without a row of this store.
        UnknownNameError: for an unknown column.
    """
    from grasp_factory.dataset.selection import read_selection, with_episode
    from grasp_factory.writers.zarr.writer import COMMITTED

    given = [] if episodes is None else [indices(episodes)]
    if ids is not None:
        rows = read_selection(ids, dataset.path)
        given.append(with_episode(rows, dataset.status == COMMITTED, dataset.path))
    given += [_matching(dataset, condition) for condition in where]
    if not given:
        return None
    common = set(given[0]).intersection(*given[1:])
    return [index for index in given[0] if index in common]


def _matching(dataset: Dataset, condition: str) -> list[int]:
    """Return the episodes that COLUMN=VALUE names."""
    column, equals, text = condition.partition("=")
    if not equals:
        what = f"--where {shown(condition)}"
        raise UsageError(f"{what}: expected COLUMN=VALUE, such as split=train")
    lookup(dict.fromkeys(dataset.columns), "column", column)
    value = parse_yaml(text, f"--where {column}")
    items = value if isinstance(value, list) else [value]
    if not all(isinstance(item, str | bool | float) or is_integer(item) for item in items):
        raise UsageError(f"--where {column}: got {shown(value)}, valid: a value, or [a, list]")
    found: list[int] = dataset.where(**{column: value}).tolist()
    return found
