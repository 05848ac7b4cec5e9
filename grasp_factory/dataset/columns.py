"""The table of a dataset's episodes: one row for each episode, with its columns."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.schema import Field
from grasp_factory.dataset.checked_reader import CheckedColumns
from grasp_factory.dataset.features import Features
from grasp_factory.dataset.joined_stores import JoinedColumns
from grasp_factory.dataset.row_lookup import RowIndex
from grasp_factory.errors import lookup
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.writer import COMMITTED

FEW_ROWS = 64
"""So many rows are always read one by one; of a large store, one in ``FEW_BLOCKS`` blocks.

Otherwise whole columns are read, most of them from packed segments."""
FEW_BLOCKS = 64


class EpisodeTable:
    """The rows of a store, with any status, or those of a view; and their columns."""

    def __init__(
        self, columns: Columns | CheckedColumns | JoinedColumns, features: Features, rows: RowIndex
    ) -> None:
        """Use a store's columns, its features, and the index of the rows."""
        self._columns, self._features, self._rows = columns, features, rows

    def __len__(self) -> int:
        """Return the number of rows: of a store with any status, of a view with an episode."""
        return len(self._rows)

    @property
    def features(self) -> Features:
        """What the store holds: each array by its path, with type, shape, unit and meaning."""
        return self._features

    @property
    def columns(self) -> list[str]:
        """The names of the columns: ``ds[name]`` reads one, ``where`` has conditions on them."""
        return list(self._columns.names)

    @property
    def indices(self) -> NDArray[np.int64]:
        """The store's row of each row, (N,)."""
        chosen = self._rows.chosen
        return np.arange(len(self)) if chosen is None else chosen.copy()

    def column(self, name: str, *, names: bool = False) -> NDArray[Any]:
        """Return a column as it is stored, shape (N, ...). Missing rows hold its fill value.

        Args:
            name: of the column.
            names: give words for coded values, as ``ds[name]`` does, instead of numbers. A code
                without a word, such as that of a missing row, is an empty text.

        Raises:
            UnknownNameError: listing the columns.
            StoreError: if it is damaged.
        """
        values = self.read_columns(name)[name]
        return in_words(self._field(name), values) if names else values

    @property
    def status(self) -> NDArray[np.uint8]:
        """The rows' status as it is now, (N,): 0 missing, 1 committed, 2 quarantined."""
        return self.column("status")

    @property
    def committed(self) -> NDArray[np.int64]:
        """Indices of the rows that hold an episode, ascending."""
        if self._rows.chosen is not None:
            return np.arange(len(self))
        return np.flatnonzero(self.status == COMMITTED)

    def read_columns(self, *names: str) -> dict[str, NDArray[Any]]:
        """Return several columns by name, each as ``column`` returns it, but read together.

        Raises:
            UnknownNameError: listing the columns.
            StoreError: if one is damaged.
        """
        for name in names:
            self._check_column(name)
        rows = self._rows.chosen
        if rows is None:
            return self._columns.read(*names)
        if len(rows) <= max(FEW_ROWS, self._columns.block_count // FEW_BLOCKS):
            return self._columns.gather(rows, *names)
        return {name: values[rows] for name, values in self._columns.read(*names).items()}

    def _field(self, column: str) -> Field:
        self._check_column(column)
        return self._features[f"episodes/{column}"]

    def _check_column(self, name: str) -> None:
        lookup(dict.fromkeys(self._columns.names), "column", name)


def in_words(field: Field, values: NDArray[Any]) -> NDArray[Any]:
    """Return the words of coded values of any shape; values of other fields as they are.

    A code without a word is an empty text.
    """
    if not field.names:
        return values
    count = len(field.names)
    codes = values.astype(np.int64)
    return np.array([*field.names, ""])[np.where((codes < 0) | (codes >= count), count, codes)]
