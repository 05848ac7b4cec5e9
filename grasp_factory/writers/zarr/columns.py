"""Read whole columns of a store, from packed segments if present, else from the blocks' own files.

Only blocks with a commit marker count; one directory listing finds them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import CHUNK
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import StoredArray, by_block
from grasp_factory.writers.zarr.budgets import TextBudget, check_column
from grasp_factory.writers.zarr.column_segments import Form, Segment, apart, segments
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import open_store, place_in
from grasp_factory.writers.zarr.layout import MOST_DIGITS

_BLOCKS_AT_ONCE = 64


class Columns:
    """The columns of a store, which may grow by blocks while it is read.

    Attributes:
        path: path of the store.
        place: the store's directory.
        config: config of the store.
        length: number of rows.
        names: column names for ``read``.
    """

    def __init__(
        self, path: Path, config: FactoryConfig, arrays: Mapping[str, StoredArray]
    ) -> None:
        """Use the arrays of a store by their path; they must include those of the columns."""
        self.path, self.config = path, config
        self.place = place_in(arrays[schema.STATUS.path].zarr).parent.parent
        self.length: int = arrays[schema.STATUS.path].zarr.shape[0]
        self._arrays = arrays
        self.names = [p.removeprefix("episodes/") for p in arrays if p.startswith("episodes/")]

    @classmethod
    def open(cls, path: Path) -> Columns:
        """Open the columns of the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store.
            StoreError: if it is damaged.
        """
        root, config = open_store(path, mode="r")
        rows = {f.path: f for f in schema.expand(config) if f.path.startswith("episodes/")}
        arrays = open_arrays(root, config, rows, {schema.STATUS.path})
        return cls(path, config, arrays)

    def blocks(self) -> NDArray[np.bool_]:
        """Return for each block whether it is present, which means that it has a commit marker.

        Raises:
            StoreError: if the directory of markers cannot be read.
        """
        try:
            names = (self.place / schema.STATUS.path).names()
        except OSError as error:
            where = f"{self.path}: {schema.STATUS.path}"
            raise StoreError(f"{where} cannot be read: {error.strerror}") from None
        there = np.zeros(self.block_count, np.bool_)
        decimal = (int(name) for name in names if name.isdecimal() and len(name) <= MOST_DIGITS)
        numbers = np.fromiter(decimal, np.int64)
        there[numbers[numbers < len(there)]] = True
        return there

    def read(self, *names: str) -> dict[str, NDArray[Any]]:
        """Return whole columns by name, each (N, ...), with fill values for missing blocks.

        Raises:
            StoreError: if one is damaged.
        """
        out = {name: self.filled(name) for name in names}
        loose, text = self.blocks(), self.text_budget()
        for segment in apart(segments(self.place)):
            if segment.is_in(loose) and self._take(segment, out, text):
                loose[segment.place] = False
        for blocks in self._together(np.flatnonzero(loose), names):
            first = self.rows(blocks[0])[0]
            self.place.root.fetch_ahead(self._files(blocks, names), CHUNK)
            for name in names:
                values = text.count(self.read_rows(name, first, self.rows(blocks[-1])[1]))
                for start, stop in map(self.rows, blocks):
                    out[name][start:stop] = values[start - first : stop - first]
        return out

    @property
    def block_count(self) -> int:
        """Number of blocks, present or not."""
        return -(-self.length // self.config.block_size)

    def gather(self, rows: NDArray[np.int64], *names: str) -> dict[str, NDArray[Any]]:
        """Return some rows (K,) of columns by name, each (K, ...), from the blocks' own files.

        Raises:
            StoreError: if they are damaged.
        """
        text = self.text_budget()
        shapes = {name: self._arrays[f"episodes/{name}"].zarr for name in names}
        out = {n: np.empty((len(rows), *a.shape[1:]), a.dtype) for n, a in shapes.items()}
        for places in by_block(rows, self.config.block_size):
            wanted = rows[places]
            first, stop = int(wanted.min()), int(wanted.max()) + 1
            for name, values in out.items():
                read = text.count(self.read_rows(name, first, stop))
                values[places] = read[wanted - first]
        return out

    def filled(self, name: str) -> NDArray[Any]:
        """Return a whole column of fill values, (N, ...).

        Raises:
            LimitError: if it is too large.
        """
        whole = self._arrays[f"episodes/{name}"].zarr
        check_column(self.place, whole)
        return np.full((self.length, *whole.shape[1:]), whole.fill_value, whole.dtype)

    def _together(self, blocks: NDArray[np.intp], names: Sequence[str]) -> Iterator[list[int]]:
        """Yield the blocks that are read together.

        These are blocks that share a file, so that each file is read only once or twice, or blocks
        that follow one another.
        """
        arrays = [self._arrays[f"episodes/{name}"].zarr for name in names]
        rows = max(((array.shards or array.chunks)[0] for array in arrays), default=1)
        if rows > self.config.block_size:
            for group in by_block(blocks * self.config.block_size, rows):
                yield blocks[group].tolist()
            return
        for run in np.split(blocks, np.flatnonzero(np.diff(blocks) > 1) + 1):
            for first in range(0, len(run), _BLOCKS_AT_ONCE):
                yield run[first : first + _BLOCKS_AT_ONCE].tolist()

    def _files(self, blocks: Sequence[int], names: Iterable[str]) -> Iterator[str]:
        """Yield the paths of columns' files in which some blocks are."""
        for path in (f"episodes/{name}" for name in names):
            array = self._arrays[path].zarr
            rows = (array.shards or array.chunks)[0]
            for number in sorted({self.rows(block)[0] // rows for block in blocks}):
                yield f"{path}/{number}{'.0' * (array.ndim - 1)}"

    def read_rows(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return some rows of a column, from the blocks' own files.

        Raises:
            StoreError: if they are damaged.
        """
        return self._arrays[f"episodes/{name}"].read(start, stop)

    def rows(self, block: int) -> tuple[int, int]:
        """Return the first row of a block, and the one after its last."""
        start = block * self.config.block_size
        return start, min(start + self.config.block_size, self.length)

    def packed(self, segment: Segment, *names: str) -> list[NDArray[Any]] | None:
        """Return a segment's rows of columns; None if it is damaged, or does not have them.

        Raises:
            LimitError: if one is too large.
        """
        return self._packed(segment, names, self.text_budget())

    def text_budget(self) -> TextBudget:
        """Return a new count of the text of columns that are read together."""
        return TextBudget(self.place)

    def _packed(
        self, segment: Segment, names: Iterable[str], text: TextBudget
    ) -> list[NDArray[Any]] | None:
        rows = self.rows(segment.blocks[-1])[1] - self.rows(segment.blocks[0])[0]
        arrays = {f"episodes/{name}": self._arrays[f"episodes/{name}"].zarr for name in names}
        forms = {path: Form((rows, *a.shape[1:]), a.dtype) for path, a in arrays.items()}
        return segment.read(forms, text)

    def _take(self, segment: Segment, out: Mapping[str, NDArray[Any]], text: TextBudget) -> bool:
        """Copy a segment's rows into the columns; return whether it has them."""
        packed = self._packed(segment, out, text)
        first = segment.blocks.start * self.config.block_size
        for column, values in zip(out.values(), packed or (), strict=packed is not None):
            column[first : first + len(values)] = values
        return packed is not None


def check_lengths(path: Path, arrays: Mapping[str, StoredArray]) -> None:
    """Check that all arrays of the store at ``path`` have the same number of rows.

    No seal covers this number.

    Raises:
        StoreError: naming an array that has another number.
    """
    rows = arrays[schema.STATUS.path].zarr.shape[0]
    for name, array in arrays.items():
        if array.zarr.shape[0] != rows:
            what = f"{name} has {array.zarr.shape[0]} rows, {schema.STATUS.path} has {rows}"
            raise StoreError(f"{path} is damaged, or growing just now: {what}")
