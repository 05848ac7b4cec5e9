"""Copying selected episodes of a store into a new store."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import is_integer
from grasp_factory.curation.merge.building import Order, build
from grasp_factory.curation.merge.provenance import seed_sources
from grasp_factory.curation.merge.result import Collected
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.staged_store import StagedStore
from grasp_factory.curation.merge.union import RowPlan
from grasp_factory.curation.versions.origin import states_of, write_origin
from grasp_factory.errors import UsageError, shown


def split(
    store: Path | str,
    out: Path | str,
    indices: Iterable[int],
    *,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[], None] = lambda: None,
) -> Collected:
    """Copy some episodes of a store into a new store, which has the root attribute ``sources``.

    Args:
        store: path of the store, which stays as it is.
        out: a path where nothing exists yet, or an empty directory.
        indices: rows that hold an episode, each once, in any order; the new store has them in
            ascending order.
        on_start: called with the number of rows to copy, after every check.
        on_row: called for each row when it has been written, read back and compared.

    Raises:
        UsageError: for rows that the store does not have, or an output path that is taken.
        StoreError: if the store is damaged, or the disk fails. Nothing is left then.
    """
    place, source = StagedStore(out), SourceStore(store)
    place.check_apart([source.place])
    chosen = source.rows(_checked(source, indices))
    plan = RowPlan(
        store=np.zeros(len(chosen.row), np.int64),
        row=chosen.row,
        seed=chosen.seed,
        index=chosen.index,
    )
    order = Order(
        place=place,
        sources=[source],
        plan=plan,
        seeds=seed_sources(plan, [source.makers], source.config),
        repeats=(plan[:0], plan[:0]),
        is_plain=False,
    )
    states = states_of([source.path])
    result = build(order, on_start, on_row)
    write_origin(out, "split", states)
    return result


def _checked(source: SourceStore, indices: Iterable[int]) -> NDArray[np.int64]:
    """Return the indices in ascending order, after a check that each is that of an episode."""
    given = list(indices)
    for index in given:
        if not is_integer(index) or not 0 <= index < len(source):
            valid = f"0 to {len(source) - 1}" if len(source) else "none, the store is empty"
            raise UsageError(f"episode {shown(index)} of {source.path}: valid: {valid}")
    if not given:
        raise UsageError(f"no episodes of {source.path} are chosen: there is nothing to split off")
    rows, counts = np.unique(np.array(given, np.int64), return_counts=True)
    if (counts > 1).any():
        twice = int(rows[counts > 1][0])
        raise UsageError(f"episode {twice} of {source.path} is chosen twice: name it once")
    for status, word in ((0, "missing"), (2, "quarantined")):
        others = rows[source.status[rows] == status]
        if len(others):
            raise UsageError(
                f"episode {others[0]} of {source.path} is {word}: only episodes that are there can"
                " be chosen"
            )
    return rows
