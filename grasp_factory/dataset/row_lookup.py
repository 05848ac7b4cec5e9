"""The rows that a user's indices name, and whether they hold episodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import StoreError, UsageError, shown
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.writer import MISSING, QUARANTINED


def chosen_rows(rows: Any, length: int) -> list[int]:
    """Return the rows that integers, or a mask, choose of a dataset.

    Args:
        rows: integers in any order, or truth values, one for each row.
        length: number of the dataset's rows.

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
        if not 0 <= row < length:
            raise UsageError(f"rows: got {shown(row)} among them, valid: 0 to {length - 1}")
    return [int(row) for row in given]


class RowIndex:
    """Finds the rows of a dataset by index; negative indices count from the end.

    The rows are all rows of a store, or those that a view has chosen, in its order.

    Attributes:
        chosen: the store's rows of a view, (K,); None for all rows of the store.
    """

    def __init__(
        self,
        store: Path,
        arrays: Mapping[str, StoredArray],
        block_size: int,
        chosen: NDArray[np.int64] | None = None,
    ) -> None:
        """Use the arrays, by their path, of the store at ``store``."""
        self._store, self._arrays, self._block_size = store, arrays, block_size
        self._statuses, self._errors = arrays["episodes/status"], arrays["episodes/error"]
        self.chosen = chosen
        self._length: int = self._statuses.zarr.shape[0] if chosen is None else len(chosen)

    def __len__(self) -> int:
        return self._length

    def only(self, rows: NDArray[np.int64] | None) -> RowIndex:
        """Return the index of a view of these rows of the store; None for all of them."""
        return RowIndex(self._store, self._arrays, self._block_size, rows)

    def present(self, index: int) -> tuple[int, int]:
        """Return an episode's row in the store, and its status.

        Raises:
            TypeError: for anything but an integer.
            IndexError: naming the valid range.
            StoreError: if the row is missing.
        """
        row = int(self.rows_at([index])[0])
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
        self.check(rows, self._statuses.gather(rows, self._block_size))
        return rows

    def check(self, rows: NDArray[np.int64], statuses: NDArray[np.uint8]) -> None:
        """Check that rows (K,) of the store hold episodes, by their statuses (K,).

        Raises:
            StoreError: naming the first row that is missing or quarantined.
        """
        for k in np.flatnonzero((statuses == MISSING) | (statuses == QUARANTINED))[:1]:
            self._refuse(int(rows[k]), int(statuses[k]))

    def rows_at(self, indices: slice | Iterable[int]) -> NDArray[np.int64]:
        """Return the rows (K,) of K indices, whether or not they hold episodes.

        Raises:
            TypeError: for anything but integers.
            IndexError: naming the valid range.
        """
        places = self.places(indices)
        return places if self.chosen is None else self.chosen[places]

    def places(self, indices: slice | Iterable[int]) -> NDArray[np.int64]:
        """Return K indices (K,), from 0, as positions in this dataset.

        Args:
            indices: a slice, integers, or a mask: an array of truth values, one for each row.

        Raises:
            TypeError: for anything else.
            IndexError: naming the valid range.
        """
        if isinstance(indices, slice):
            return np.arange(self._length)[indices]
        if isinstance(indices, np.ndarray):
            return self._places_of(indices)
        return np.array([self._place(index) for index in indices], np.int64)

    def _places_of(self, indices: NDArray[Any]) -> NDArray[np.int64]:
        if indices.ndim != 1:
            got = f"an array of shape {indices.shape}"
            raise TypeError(f"episode indices: got {got}, valid: shape (K,)")
        if indices.dtype.kind == "b":
            if len(indices) != self._length:
                got = f"a mask of {len(indices)} truth values"
                raise IndexError(f"episode indices: got {got}, valid: {self._length} of them")
            return np.flatnonzero(indices)
        if indices.dtype.kind not in "iu":
            return np.array([self._place(index) for index in indices], np.int64)
        for index in indices[(indices < -self._length) | (indices >= self._length)][:1]:
            self._place(index)
        return np.where(indices < 0, indices + self._length, indices).astype(np.int64)

    def _place(self, index: Any) -> int:
        if isinstance(index, bool | np.bool_):
            what = f"episode index: got {shown(index)}, valid: an integer"
            raise TypeError(f"{what}; for a mask: ds[np.array(mask)]")
        if not is_integer(index):
            what = f"episode index: got {shown(index)}, valid: one integer, as in ds[3]"
            raise TypeError(f"{what}; for several: ds[3:10] or ds[[3, 5]]")
        size = self._length
        if not -size <= index < size:
            valid = f"valid: {-size} to {size - 1}" if size else "there are no episodes"
            raise IndexError(f"episode {index}: {valid}")
        return int(index) % size

    def _refuse(self, row: int, status: int) -> NoReturn:
        """Raise the StoreError of a row that is missing or quarantined."""
        if status == MISSING:
            raise StoreError(f"{self._store}: episode {row} is missing")
        reason = self._errors.read(row, row + 1)[0]
        raise StoreError(f"{self._store}: episode {row} is quarantined: {reason}")
