"""The table of a store's episodes: one row for each episode, and selection of rows by columns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.schema import Field
from grasp_factory.core.splits import SPLITS
from grasp_factory.dataset.balanced_sampling import draw_evenly
from grasp_factory.dataset.checked_reader import CheckedColumns
from grasp_factory.dataset.filters import matching
from grasp_factory.dataset.row_lookup import RowIndex
from grasp_factory.errors import UsageError, lookup
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.writer import COMMITTED


class EpisodeTable:
    """The rows of a store, with any status, and their columns."""

    def __init__(
        self, columns: Columns | CheckedColumns, fields: Mapping[str, Field], rows: RowIndex
    ) -> None:
        """Use a store's columns, their fields by path, and its row index."""
        self._columns, self._fields, self._rows = columns, fields, rows

    def __len__(self) -> int:
        """Return the number of rows, with any status."""
        return self._columns.length

    @property
    def fields(self) -> Mapping[str, Field]:
        """The fields of the store's arrays, by path: dimensions, type, unit, frame and codes."""
        return self._fields

    @property
    def columns(self) -> list[str]:
        """The names that ``column`` and ``where`` take."""
        return list(self._columns.names)

    def column(self, name: str) -> NDArray[Any]:
        """Return a whole column, shape (N, ...); rows that are missing hold its fill value.

        Raises:
            UnknownNameError: listing the columns.
            StoreError: if it is damaged.
        """
        self._check_column(name)
        return self._columns.read(name)[name]

    @property
    def status(self) -> NDArray[np.uint8]:
        """The rows' status as it is now, (N,): 0 missing, 1 committed, 2 quarantined."""
        return self.column("status")

    @property
    def committed(self) -> NDArray[np.int64]:
        """Indices of the rows that hold an episode, ascending."""
        return np.flatnonzero(self.status == COMMITTED)

    def where(self, **conditions: Any) -> NDArray[np.int64]:
        """Return the committed rows, ascending, that fulfil all conditions.

        A condition is a column's name and a value, a ``Range`` of numbers, or a list of these, any
        of which may match. A text that no row of a text column has, as in ``policy="nope"``,
        matches no row. NaN equals no value.

        Example: ``where(success=False, outcome=["no_contact", "collision"], split="train")``,
        ``where(lift_height=Range(at_least=0.05), object_mass=Range(0.1, 0.2))``.

        Raises:
            UnknownNameError: for a column that does not exist, or a name that a column of
                coded values does not have.
            UsageError: for a value of another type than the column's, a range for a column that
                is not numeric, or a column with more than one value per row.
        """
        for name in conditions:
            self._check_column(name)
        columns = self._columns.read("status", *conditions)
        keep = columns["status"] == COMMITTED
        for name, value in conditions.items():
            keep &= matching(self._fields[f"episodes/{name}"], columns[name], value)
        return np.flatnonzero(keep)

    def split(self, name: str) -> NDArray[np.int64]:
        """Return the committed rows of ``train``, ``val`` or ``test``, ascending.

        The split is a property of the target object. The other objects of its scene belong to the
        same split, so that no object of one split occurs in another.

        Raises:
            UnknownNameError: for another name.
        """
        lookup(dict.fromkeys(SPLITS), "split", name)
        return self.where(split=name)

    def balanced(
        self,
        rows: Iterable[int] | None = None,
        by: str = "success",
        n: int | None = None,
        seed: int = 0,
    ) -> NDArray[np.int64]:
        """Return randomly drawn rows, with equally many rows of each value of a column.

        The counts of the values differ by at most one. Rows of a value are repeated only if n
        requires more of them than there are; their numbers of repetitions differ by at most one.

        Args:
            rows: The rows to draw from, in any order; duplicates are ignored. None for all
                committed rows.
            by: A column of strings, booleans or integers.
            n: How many rows to draw; None for the most that need no repetition.
            seed: The same rows, n and seed yield the same draw.

        Returns:
            (n,), in random order.

        Raises:
            UnknownNameError: for a column that does not exist.
            UsageError: for a column of another type, for rows with fewer than two different
                values, or for an invalid n or seed.
            IndexError, StoreError: for a row that holds no episode.
        """
        self._check_column(by)
        columns = self._columns.read("status", by)
        values = columns[by]
        if values.ndim > 1 or values.dtype.kind == "f":
            has = f"{values.shape[1:]} values a row" if values.ndim > 1 else "real numbers"
            valid = "one word, truth value or whole number a row, such as success or outcome"
            raise UsageError(f"balanced: {by} has {has}, valid: {valid}")
        is_there = columns["status"] == COMMITTED
        if rows is None:
            chosen = np.flatnonzero(is_there)
        else:
            chosen = np.unique(self._rows.rows_at(rows))
            self._rows.several(chosen[~is_there[chosen]][:1])
        try:
            return chosen[draw_evenly(values[chosen], n, seed)]
        except UsageError as error:
            raise UsageError(f"balanced by {by}: {error}") from None

    def _check_column(self, name: str) -> None:
        lookup(dict.fromkeys(self._columns.names), "column", name)
