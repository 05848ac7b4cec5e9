"""Transfer of added labels, row by row."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.place import place_of
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.union import NOBODY, RowPlan
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.label_columns import (
    LONGEST_NAME,
    NOT_LABELLED,
    label_thresholds,
    write_label,
)
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, is_sealed, values_digest


@dataclass(frozen=True, slots=True, kw_only=True)
class CopiedLabel:
    """An added label of the result."""

    name: str
    outcome: NDArray[np.uint8]
    """(N,)."""
    thresholds: Mapping[str, Any]

    def write(self, store: Path) -> None:
        """Add the label to the result."""
        write_label(store, self.name, self.outcome, self.thresholds)


def carried_labels(
    sources: Sequence[SourceStore], plan: RowPlan
) -> tuple[tuple[CopiedLabel, ...], dict[str, str]]:
    """Return the labels that all stores have with the same thresholds, and why others are left out.

    Only the stores from which the plan takes rows are considered.

    Raises:
        StoreError: if a label is damaged.
    """
    used = np.unique(plan.store[plan.store != NOBODY]).tolist()
    carried: list[CopiedLabel] = []
    left_out: dict[str, str] = {}
    for name in sorted({name for k in used for name in sources[k].labels()}):
        lacking = [str(sources[k].path) for k in used if name not in sources[k].labels()]
        if not name.isidentifier() or len(name) > LONGEST_NAME:
            left_out[name] = "relabel gives no such names"
        elif lacking:
            left_out[name] = f"{lacking[0]} has none of that name"
        elif label := _carried(sources, plan, used, name):
            carried.append(label)
        else:
            left_out[name] = "its thresholds are not the same everywhere"
    return tuple(carried), left_out


def _carried(
    sources: Sequence[SourceStore], plan: RowPlan, used: Iterable[int], name: str
) -> CopiedLabel | None:
    """Return a label that all stores have; None if its thresholds differ."""
    outcome = np.full(len(plan), NOT_LABELLED, np.uint8)
    thresholds: list[Mapping[str, Any]] = []
    for k in used:
        values, attributes = _read(sources[k], name)
        where = f"{sources[k].path}: labels/{name}"
        thresholds.append(label_thresholds(where, attributes))
        mine = np.flatnonzero(plan.store == k)
        mine = mine[plan.row[mine] < len(values)]  # the store may have grown since
        outcome[mine] = values[plan.row[mine]]
    if any(other != thresholds[0] for other in thresholds):
        return None
    return CopiedLabel(name=name, outcome=outcome, thresholds=thresholds[0])


def _read(source: SourceStore, name: str) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    folder = place_of(source.path) / "labels" / name
    values, attributes = source.label(name)
    whole = attributes.get(VALUES_SEAL) == values_digest(values)
    if not (whole and is_sealed(folder / "outcome" / "zarr.json")):
        raise StoreError(f"{folder} is damaged: remove that directory, and relabel if you need it")
    return values, attributes
