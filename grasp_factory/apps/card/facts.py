"""The facts of a store that a card shows, counted from one reading of its columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.card.table import NOT_IN_TABLE, Kind, TableColumn, column_of
from grasp_factory.core import schema
from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.real_columns import Source
from grasp_factory.core.splits import SPLITS
from grasp_factory.dataset.counts import (
    count_outcomes,
    count_platforms,
    count_scores,
    count_statuses,
    most_frequent_first,
)
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError, UsageError
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.sizes import store_bytes
from grasp_factory.writers.zarr.writer import COMMITTED, QUARANTINED

GROUPED = ("split", "policy", "object_set", "object_family")
"""Columns whose values the card counts, if the store has them."""
_NEEDED = ("success", "outcome", "object_id", "split")


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """The committed episodes with one value of a column."""

    word: str
    episodes: int
    successes: int
    objects: int
    """Distinct targets."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AddedLabel:
    """A label that was added to the store in addition to its own."""

    name: str
    thresholds: Mapping[str, Any]
    episodes: int
    """Committed episodes that have it."""
    successes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CardFacts:
    """The contents of a store.

    The first four fields, ``reasons`` and ``platforms`` describe all rows, the others only the
    committed episodes.
    """

    rows: int
    quarantined: int
    missing: int
    bytes: int
    total: Group
    real: int
    """How many of these were recorded with real devices."""
    groups: Mapping[str, tuple[Group, ...]]
    """By column of ``GROUPED``; splits in their usual order, other groups the largest first."""
    outcomes: Mapping[str, int]
    """Episodes by outcome, for the outcomes that occur, in their fixed order."""
    quality: Mapping[str, int]
    """Episodes by score, the best first; empty for stores that are older than scores."""
    reasons: Mapping[str, int]
    """Number of quarantined rows by reason, the most frequent first."""
    platforms: Mapping[str, int]
    """Number of rows by fingerprint, the most frequent first."""
    labels: tuple[AddedLabel, ...]
    table: tuple[TableColumn, ...]
    """The columns of the table of episodes; see module ``table``."""

    def values(self) -> dict[str, NDArray[Any]]:
        """Return the columns of the table by name, (n,) each."""
        return {column.name: column.values for column in self.table}


def read_facts(dataset: Dataset) -> CardFacts:
    """Read and count the present contents of a store.

    Raises:
        UsageError: for a store without episodes.
        StoreError: if it is damaged.
    """
    columns = Columns.open(dataset.path)
    fields = [f for f in schema.expand(dataset.config) if _is_in_table(f, columns)]
    wanted = [field.path.removeprefix("episodes/") for field in fields]
    if lost := [name for name in _NEEDED if name not in wanted]:
        what = f"{dataset.path} is damaged: it has no column {', '.join(lost)}"
        raise StoreError(f"{what}; run grasp-factory verify on it, and repair")
    # In one read: another process may add rows, and all columns must have the same rows.
    read = columns.read("status", *wanted)
    status = read.pop("status")
    made = np.flatnonzero(status == COMMITTED)
    if not len(made):
        what = f"{dataset.path} has no episodes to describe"
        raise UsageError(f"{what}: `grasp-factory generate --out {dataset.path}` makes some")
    own = [column_of(f, read[name][made]) for f, name in zip(fields, wanted, strict=True)]
    labels, label_columns = _labels(dataset, made)
    row = TableColumn(
        name="row",
        kind=Kind.INTEGER,
        description="row of the store: Dataset(PATH)[row] is the episode",
        values=made,
    )
    values = {column.name: column.values for column in own}
    success, objects = values["success"], values["object_id"]
    missing, _, quarantined = count_statuses(status)
    return CardFacts(
        rows=len(status),
        quarantined=quarantined,
        missing=missing,
        bytes=store_bytes(columns),
        total=_group("", success, objects),
        real=int((values["source"] == Source.REAL).sum()) if "source" in values else 0,
        groups={
            name: _groups(name, values[name], success, objects)
            for name in GROUPED
            if name in values
        },
        outcomes=count_outcomes(values["outcome"]),
        quality=count_scores(values["quality"]) if "quality" in values else {},
        reasons=_reasons(columns, np.flatnonzero(status == QUARANTINED)),
        platforms=_platforms(columns),
        labels=labels,
        table=(row, *own, *label_columns),
    )


def _is_in_table(field: schema.Field, columns: Columns) -> bool:
    group, _, name = field.path.partition("/")
    is_read = group == "episodes" and name in columns.names and not field.dims
    return is_read and field.path not in NOT_IN_TABLE


def _groups(
    column: str, words: NDArray[Any], success: NDArray[np.bool_], objects: NDArray[Any]
) -> tuple[Group, ...]:
    found = sorted(set(words.tolist()))
    groups = [_group(word, success[words == word], objects[words == word]) for word in found]
    if column == "split":
        places = {word: place for place, word in enumerate(SPLITS)}
        return tuple(sorted(groups, key=lambda group: places.get(group.word, len(places))))
    return tuple(sorted(groups, key=lambda group: -group.episodes))


def _group(word: str, success: NDArray[np.bool_], objects: NDArray[Any]) -> Group:
    return Group(
        word=word,
        episodes=len(success),
        successes=int(success.sum()),
        objects=len(set(objects.tolist())),
    )


def _reasons(columns: Columns, rows: NDArray[np.int64]) -> dict[str, int]:
    if "error" not in columns.names:
        return {}
    found = Counter(str(columns.read_rows("error", i, i + 1)[0]) for i in rows.tolist())
    return most_frequent_first(found)


def _platforms(columns: Columns) -> dict[str, int]:
    if "fingerprint" not in columns.names:
        return {}
    return count_platforms(columns.read("fingerprint")["fingerprint"].tolist())


def _labels(
    dataset: Dataset, made: NDArray[np.int64]
) -> tuple[tuple[AddedLabel, ...], list[TableColumn]]:
    """Return the added labels, and a column of the table for each."""
    labels, columns = [], []
    for name in dataset.labels:
        stored = dataset.label(name)
        there = made[made < len(stored)]
        outcome = np.full(len(made), len(Outcome), np.uint8)
        outcome[: len(there)] = stored[there]
        labels.append(
            AddedLabel(
                name=name,
                thresholds=dataset.label_thresholds(name),
                episodes=int(np.sum(outcome < len(Outcome))),
                successes=int(np.sum(outcome == Outcome.SUCCESS)),
            )
        )
        columns.append(
            TableColumn(
                name=f"labels/{name}",
                kind=Kind.TEXT,
                description=f"outcome by the thresholds of the added label {name}",
                values=outcome,
                words=tuple(names(Outcome)),
            )
        )
    return tuple(labels), columns
