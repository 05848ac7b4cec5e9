"""The mapping from rows of the source stores to rows of the result, as arrays of numbers.

Of episodes that several stores have, one stays. ``repeat_check`` refuses those that differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
NOBODY = -1
"""Replaces a store's position for a row that no store has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Rows of one store in the store's order, with seed and index of their recipes."""

    row: Integers
    """(R,)."""
    seed: Integers
    """(R,)."""
    index: Integers
    """(R,)."""
    is_quarantined: NDArray[np.bool_]
    """(R,)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RowPlan:
    """Where each row of the result comes from."""

    store: Integers
    """(N,) position among the stores, or ``NOBODY``."""
    row: Integers
    """(N,) row there."""
    seed: Integers
    """(N,)."""
    index: Integers
    """(N,)."""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.store)

    def __getitem__(self, rows: Any) -> RowPlan:
        """Return the plan of some rows."""
        return RowPlan(**{name: getattr(self, name)[rows] for name in self.__slots__})

    def runs(self) -> list[tuple[int, int, int]]:
        """Return (store, first row, row after the last) of each run of consecutive rows.

        All rows of a run come from one store. Rows that no store has are in no run.
        """
        out: list[tuple[int, int, int]] = []
        for store, row in zip(self.store.tolist(), self.row.tolist(), strict=True):
            if store == NOBODY:
                continue
            if out and out[-1][0] == store and out[-1][2] == row:
                out[-1] = (store, out[-1][1], row + 1)
            else:
                out.append((store, row, row + 1))
        return out


@dataclass(frozen=True, slots=True, kw_only=True)
class Union:
    """The rows of several stores, each recipe once."""

    plan: RowPlan
    """Grouped by seed, in the order in which seeds first appear in the stores; then by index."""
    repeats: tuple[RowPlan, RowPlan]
    """(K,) each: rows that are left out, and the rows that replace them. Their contents must be
    the same."""


def union(stores: Sequence[Rows]) -> Union:
    """Return the rows of all stores, each (seed, index) once.

    The row comes from the first store that has committed the episode; if there is no such store,
    from the first that has quarantined it.

    Args:
        stores: at least one.
    """
    store = np.repeat(np.arange(len(stores)), [len(rows.row) for rows in stores])
    row, seed, index, is_quarantined = (
        np.concatenate([getattr(rows, name) for rows in stores])
        for name in ("row", "seed", "index", "is_quarantined")
    )
    _, first, which = np.unique(seed, return_index=True, return_inverse=True)
    everything = RowPlan(store=store, row=row, seed=seed, index=index)
    everything = everything[np.lexsort((store, is_quarantined, index, first[which]))]
    seed, index = everything.seed, everything.index
    is_new = np.ones(len(seed), np.bool_)
    is_new[1:] = (seed[1:] != seed[:-1]) | (index[1:] != index[:-1])
    originals = np.maximum.accumulate(np.where(is_new, np.arange(len(seed)), 0))
    left_out = np.flatnonzero(~is_new)
    return Union(
        plan=everything[is_new], repeats=(everything[left_out], everything[originals[left_out]])
    )


def in_place(plan: RowPlan, seed: int, length: int) -> RowPlan:
    """Return the plan of a store in which a row's number equals the index of its recipe.

    Args:
        plan: rows of one seed.
        seed: their seed.
        length: number of rows of that store.
    """
    store, row = np.full(length, NOBODY, np.int64), np.zeros(length, np.int64)
    store[plan.index], row[plan.index] = plan.store, plan.row
    return RowPlan(store=store, row=row, seed=np.full(length, seed), index=np.arange(length))
