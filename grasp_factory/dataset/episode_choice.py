"""Choosing rows of a dataset: each method returns a view, which is a dataset of these rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.serialization import is_integer
from grasp_factory.core.splits import SPLITS
from grasp_factory.dataset.balanced_sampling import draw_evenly
from grasp_factory.dataset.columns import FEW_ROWS, EpisodeTable
from grasp_factory.dataset.filters import matching
from grasp_factory.errors import UsageError, lookup, shown
from grasp_factory.writers.zarr.writer import COMMITTED


class EpisodeChoice(EpisodeTable, ABC):
    """Rows that can be chosen.

    A view holds row numbers alone: it reads nothing until it is asked, shares its files with the
    dataset that it was made of, and is pickled as the store's path and the row numbers. All its
    rows have an episode. A row may come twice.
    """

    @abstractmethod
    def __iter__(self) -> Iterator[Episode]:
        """Iterate over the episodes in their order."""

    @abstractmethod
    def __getitem__(self, index: Any) -> Any:
        """Return an episode by its index, a column by its name, or a view of several rows."""

    @property
    def whole(self) -> Self:
        """The dataset of all rows of the store; this one, unless it is a view."""
        return self if self._rows.chosen is None else self._view(None)

    def select(self, indices: slice | Iterable[int]) -> Self:
        """Return a view of rows in the order of their indices, as ``ds[indices]`` does.

        Args:
            indices: a slice; integers in any order, also twice or negative; or a mask, which is an
                array of truth values, one for each row.

        Raises:
            TypeError: for anything else.
            IndexError: naming the valid range.
            StoreError: naming the first row that is missing or quarantined.
        """
        rows = self._rows.rows_at(indices)
        if self._rows.chosen is None:
            if len(rows) <= FEW_ROWS:
                return self._view(self._rows.several(rows))
            self._rows.check(rows, self.status[rows])
        return self._view(rows)

    def shuffle(self, seed: int = 0) -> Self:
        """Return a view of the episodes in random order; the same seed yields the same order.

        Raises:
            UsageError: for an invalid seed.
        """
        if not is_integer(seed) or seed < 0:
            raise UsageError(f"seed: got {shown(seed)}, valid: a whole number from 0 on")
        rows = self._rows.rows_at(self.committed)
        return self._view(np.random.default_rng(seed).permutation(rows))

    def where(self, **conditions: Any) -> Self:
        """Return a view of the episodes that fulfil all conditions, in the order of this dataset.

        A condition is a column's name and a value, a ``Range`` of numbers, or a list of these, any
        of which may match. NaN equals no value.

        Example: ``where(success=False, outcome=["no_contact", "collision"], split="train")``,
        ``where(lift_height=Range(at_least=0.05), object_mass=Range(0.1, 0.2))``.

        Raises:
            UnknownNameError: for a column that does not exist, a name that a column of coded
                values does not have, or a text that no row of the store has in this column.
            UsageError: for a value of another type than the column's, a range for a column that
                is not numeric, or a column with more than one value per row.
        """
        fields = {name: self._field(name) for name in conditions}
        is_view = self._rows.chosen is not None
        columns = self.read_columns(*(() if is_view else ("status",)), *conditions)
        keep = np.ones(len(self), np.bool_) if is_view else columns["status"] == COMMITTED
        for name, value in conditions.items():
            keep &= matching(fields[name], columns[name], value, partial(self._texts, name))
        return self._view(self._rows.rows_at(np.flatnonzero(keep)))

    def split(self, name: str) -> Self:
        """Return a view of the episodes of ``train``, ``val`` or ``test``.

        The split is a property of the target object. The other objects of its scene belong to the
        same split, so that no object of one split occurs in another.

        Raises:
            UnknownNameError: for another name.
        """
        lookup(dict.fromkeys(SPLITS), "split", name)
        return self.where(split=name)

    def filter(
        self, function: Callable[..., Any], input_columns: str | Sequence[str] | None = None
    ) -> Self:
        """Return a view of the episodes for which a function is true; conditions are faster.

        Args:
            function: takes an ``Episode``; or, with ``input_columns``, the values of these columns.
            input_columns: names of columns, as of ``ds[name]``; then nothing else is read.

        Raises:
            UnknownNameError: for an unknown column.
            StoreError: if an episode is damaged.
        """
        if input_columns is None:
            keep = [bool(function(episode)) for episode in self]
            return self.select(self.committed[np.array(keep, np.bool_)])
        names = [input_columns] if isinstance(input_columns, str) else input_columns
        mine = self.select(self.committed)
        columns = [mine[name].tolist() for name in names]
        kept = [bool(function(*values)) for values in zip(*columns, strict=True)]
        return mine.select(np.array(kept, np.bool_))

    def balanced(self, by: str = "success", n: int | None = None, seed: int = 0) -> Self:
        """Return a view of randomly drawn episodes, with equally many of each value of a column.

        The counts of the values differ by at most one. Rows of a value are repeated only if n
        requires more of them than there are; their numbers of repetitions differ by at most one.
        The draw depends on which rows there are, not on their order, or how often each comes.

        Args:
            by: A column of strings, booleans or integers.
            n: How many rows to draw; None for the most that need no repetition.
            seed: The same rows, n and seed yield the same draw.

        Raises:
            UnknownNameError: for a column that does not exist.
            UsageError: for a column of another type, for rows with fewer than two different
                values, or for an invalid n or seed.
        """
        self._check_column(by)
        rows = np.unique(self._rows.rows_at(self.committed))
        values = self._view(rows).column(by)
        if values.ndim > 1 or values.dtype.kind == "f":
            has = f"{values.shape[1:]} values a row" if values.ndim > 1 else "real numbers"
            valid = "one word, truth value or whole number a row, such as success or outcome"
            raise UsageError(f"balanced: {by} has {has}, valid: {valid}")
        try:
            return self._view(rows[draw_evenly(values, n, seed)])
        except UsageError as error:
            raise UsageError(f"balanced by {by}: {error}") from None

    def _texts(self, column: str) -> set[str]:
        """Return the texts that the rows of the whole store have in a column."""
        return {*self.whole.column(column).tolist()}

    def _view(self, rows: NDArray[np.int64] | None) -> Self:
        """Return the dataset of some rows of the store, which are known to hold episodes."""
        view = object.__new__(type(self))
        view.__dict__.update(self.__dict__, _rows=self._rows.only(rows))
        return view
