"""The options that choose rows of a store: ``--episodes``, ``--ids`` and ``--where``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import click

from grasp_factory.cli.params import option, options
from grasp_factory.core.config.yaml_loader import parse_yaml
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import UsageError, lookup, shown

if TYPE_CHECKING:
    from grasp_factory.dataset.dataset import Dataset

_choice = partial(option, heading="Choice of episodes")

IDS = _choice(
    "--ids",
    metavar="FILE",
    type=click.File(),
    help="File with one episode index per line, as `query --ids` prints it; - for stdin.",
)
list_options = options(
    _choice("--episodes", metavar="I,J,...", help="Episode indices, separated by commas."), IDS
)
"""Adds the options that list rows; the command passes their values to ``listed_rows``."""
row_options = options(
    list_options,
    _choice(
        "--where",
        metavar="COLUMN=VALUE",
        multiple=True,
        help="Episodes with this value, or with one of several, as in"
        " policy=[top_down,uniform]. Repeatable; all must hold.",
    ),
)
"""Adds the options that choose rows; the command passes their values to ``chosen_rows``."""


def listed_rows(
    path: Path, episodes: str | None, ids: TextIO | None, has_episode: Sequence[bool] | None = None
) -> list[int] | None:
    """Return the rows that both options list, in the first one's order; None without options.

    Args:
        path: The store.
        episodes: Indices as in I,J,...
        ids: See ``read_selection``.
        has_episode: If given, rows of ``ids`` without an episode are left out with a warning.

    Raises:
        UsageError: for a text that is not valid, or a list without a row of this store.
    """
    from grasp_factory.dataset.selection import read_selection, with_episode

    lists = [] if episodes is None else [_indices(episodes)]
    if ids is not None:
        rows = read_selection(ids, path)
        lists.append(rows if has_episode is None else with_episode(rows, has_episode, path))
    return _common(lists)


def chosen_rows(
    dataset: Dataset, *, episodes: str | None, ids: TextIO | None, where: tuple[str, ...]
) -> list[int] | None:
    """Return the rows that all options choose, in the first one's order; None without options.

    Raises:
        UsageError: for a text that is not valid, or a list without a row of this store.
        UnknownNameError: for an unknown column.
    """
    from grasp_factory.writers.zarr.writer import COMMITTED

    listed = listed_rows(dataset.path, episodes, ids, dataset.status == COMMITTED)
    lists = [] if listed is None else [listed]
    return _common([*lists, *_matching_each(dataset, where)])


def chosen_of_each(
    datasets: Sequence[Dataset], *, episodes: str | None, ids: TextIO | None, where: tuple[str, ...]
) -> list[list[int]]:
    """Return the rows of each dataset that all options choose; all its episodes without options.

    Args:
        datasets: One or several.
        episodes: Indices as in I,J,..., for one dataset only.
        ids: See ``read_lines``; for several datasets each line names its store.
        where: Conditions on columns.

    Raises:
        UsageError: for a text that is not valid, or lists without a row of these stores.
        UnknownNameError: for an unknown column.
    """
    if len(datasets) == 1:
        rows = chosen_rows(datasets[0], episodes=episodes, ids=ids, where=where)
        return [datasets[0].committed.tolist() if rows is None else rows]
    from grasp_factory.dataset.selection import read_selections

    if episodes is not None:
        raise UsageError("--episodes: valid for one store only; use --ids with lines STORE:ROW")
    listed = None if ids is None else read_selections(ids, [dataset.path for dataset in datasets])
    chosen = []
    for k, dataset in enumerate(datasets):
        there = dataset.committed.tolist()
        lists = [there if listed is None else _with_episode(listed[k], dataset)]
        lists += _matching_each(dataset, where)
        chosen.append(_common(lists) or [])
    return chosen


def _with_episode(rows: list[int], dataset: Dataset) -> list[int]:
    from grasp_factory.dataset.selection import with_episode
    from grasp_factory.writers.zarr.writer import COMMITTED

    return with_episode(rows, dataset.status == COMMITTED, dataset.path)


def _common(lists: Sequence[list[int]]) -> list[int] | None:
    """Return the rows that are in every list, in the first one's order; None without lists."""
    if not lists:
        return None
    common = set(lists[0]).intersection(*lists[1:])
    return [row for row in lists[0] if row in common]


def _indices(text: str) -> list[int]:
    if not re.fullmatch(r"[0-9]{1,9}(,[0-9]{1,9})*", text):
        raise UsageError(f"--episodes: got {shown(text)}, valid: indices such as 0,3,7")
    return [int(word) for word in text.split(",")]


def _matching_each(dataset: Dataset, where: Sequence[str]) -> list[list[int]]:
    """Return the episodes for which each condition holds.

    Raises:
        UsageError: for a condition that is not valid, or two on a column that exclude each other.
    """
    found = {condition: _matching(dataset, condition) for condition in where}
    for first, second in combinations(found, 2):
        column, _, value = first.partition("=")
        other, _, more = second.partition("=")
        is_never = found[first] and found[second] and not {*found[first]} & {*found[second]}
        if column == other and is_never:
            texts = ",".join(text.strip("[]") for text in (value, more))
            what = f"--where {shown(first)} and {shown(second)}: no episode has both"
            raise UsageError(f"{what}, valid: {column}=[{texts}] for any of them")
    return list(found.values())


def _matching(dataset: Dataset, condition: str) -> list[int]:
    """Return the episodes for which COLUMN=VALUE holds."""
    column, equals, text = condition.partition("=")
    if not equals:
        what = f"--where: got {shown(condition)}"
        raise UsageError(f"{what}, valid: COLUMN=VALUE, such as split=train")
    lookup(dict.fromkeys(dataset.columns), "column", column)
    value = parse_yaml(text, f"--where {column}")
    items = value if isinstance(value, list) else [value]
    if not all(isinstance(item, str | bool | float) or is_integer(item) for item in items):
        raise UsageError(f"--where {column}: got {shown(value)}, valid: a value, or [a, list]")
    found: list[int] = dataset.where(**{column: value}).indices.tolist()
    return found
