"""The rows that a user's indices name, and whether they hold episodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import StoreError, UsageError, shown
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.writer import MISSING, QUARANTINED


def chosen_rows(rows: Any, length: int) -> list[int]:
    """Return the rows that integers, or a mask, choose of a store.

    Args:
        rows: integers in any order, or truth values, one for each row of the store.
        length: number of the store's rows.

    Raises:
        UsageError: for anything else.
    """
    valid = f"valid: integers, or a mask of {length} truth values"
    try:
        given = None if isinstance(rows, str | bytes) else list(rows)
    except TypeError:
        given = None
    if given is None:
        raise UsageError(f"rows: got {shown(rows)}, {valid}")
    if given and all(isinstance(row, bool | np.bool_) for row in given):
        if len(given) != length:
            raise UsageError(f"rows: got {len(given)} truth values, {valid}")
        return [place for place, is_chosen in enumerate(given) if is_chosen]
    for row in given:
        if not is_integer(row):
            raise UsageError(f"rows: got {shown(row)} among them, {valid}")
    return [int(row) for row in given]


class RowIndex:
    """Finds rows by index; negative indices count from the end."""

    def __init__(self, store: Path, arrays: Mapping[str, StoredArray], block_size: int) -> None:
        """Use the arrays, by their path, of the store at ``store``."""
        self._store, self._block_size = store, block_size
        self._statuses, self._errors = arrays["episodes/status"], arrays["episodes/error"]
        self._length: int = self._statuses.zarr.shape[0]

    def present(self, index: int) -> tuple[int, int]:
        """Return an episode's row, counted from the start, and its status.

        Raises:
            TypeError: for anything but an integer.
            IndexError: naming the valid range.
            StoreError: if the row is missing.
        """
        row = self._row(index)
        status = int(self._statuses.read(row, row + 1)[0])
        if status == MISSING:
            self._refuse(row, status)
        return row, status

    def committed(self, index: int) -> int:
        """Return the row of an episode that is not quarantined; see ``present``."""
        row, status = self.present(index)
        if status == QUARANTINED:
            self._refuse(row, status)
        return row

    def several(self, indices: slice | Iterable[int]) -> NDArray[np.int64]:
        """Return the rows (K,) of K episodes, in the order of their indices.

        Raises:
            TypeError: for anything but integers.
            IndexError: naming the valid range.
            StoreError: naming the first row that is missing or quarantined.
        """
        rows = self.rows_at(indices)
        statuses = self._statuses.gather(rows, self._block_size)
        for k in np.flatnonzero((statuses == MISSING) | (statuses == QUARANTINED))[:1]:
            self._refuse(int(rows[k]), int(statuses[k]))
        return rows

    def rows_at(self, indices: slice | Iterable[int]) -> NDArray[np.int64]:
        """Return the rows (K,) of K indices, whether or not they hold episodes.

        Raises:
            TypeError: for anything but integers.
            IndexError: naming the valid range.
        """
        if isinstance(indices, slice):
            return np.arange(self._length)[indices]
        if isinstance(indices, np.ndarray) and indices.ndim != 1:
            got = f"an array of shape {indices.shape}"
            raise TypeError(f"episode indices: got {got}, valid: shape (K,)")
        return np.array([self._row(index) for index in indices], np.int64)

    def _row(self, index: Any) -> int:
        if isinstance(index, bool | np.bool_):
            what = f"episode index: got {shown(index)}, valid: an integer"
            raise TypeError(f"{what}; for a mask: ds[np.flatnonzero(mask)]")
        if not is_integer(index):
            what = f"episode index: got {shown(index)}, valid: one integer, as in ds[3]"
            raise TypeError(f"{what}; for several: ds[3:10] or ds[[3, 5]]")
        size = self._length
        if not -size <= index < size:
            valid = f"valid: {-size} to {size - 1}" if size else "the store has no episodes"
            raise IndexError(f"episode {index}: {valid}")
        return int(index) % size

    def _refuse(self, row: int, status: int) -> None:
        if status == MISSING:
            raise StoreError(f"{self._store}: episode {row} is missing")
        reason = self._errors.read(row, row + 1)[0]
        raise StoreError(f"{self._store}: episode {row} is quarantined: {reason}")
