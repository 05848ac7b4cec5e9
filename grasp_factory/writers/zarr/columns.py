"""Read whole columns of a store, from packed segments if present, else from the blocks' own files.

Only blocks with a commit marker count; one directory listing finds them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import StoredArray, open_arrays
from grasp_factory.writers.zarr.column_segments import Segment, segments
from grasp_factory.writers.zarr.header import open_store


class Columns:
    """The columns of a store, which may grow by blocks while it is read.

    Attributes:
        path: path of the store.
        config: config of the store.
        length: number of rows.
        names: column names for ``read``.
    """

    def __init__(
        self, path: Path, config: FactoryConfig, arrays: Mapping[str, StoredArray]
    ) -> None:
        """Use the arrays of a store by their path; they must include those of the columns."""
        self.path = path
        self.config = config
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
        paths = [row.path for row in schema.expand(config) if row.path.startswith("episodes/")]
        arrays = open_arrays(root, path, paths, {schema.STATUS.path})
        return cls(path, config, arrays)

    def blocks(self) -> NDArray[np.bool_]:
        """Return for each block whether it is present, which means that it has a commit marker.

        Raises:
            StoreError: if the directory of markers cannot be read.
        """
        try:
            names = os.listdir(self.path / schema.STATUS.path)
        except OSError as error:
            where = f"{self.path}: {schema.STATUS.path}"
            raise StoreError(f"{where} cannot be read: {error.strerror}") from None
        there = np.zeros(-(-self.length // self.config.block_size), np.bool_)
        numbers = np.fromiter(map(int, filter(str.isdecimal, names)), np.int64)
        there[numbers[numbers < len(there)]] = True
        return there

    def read(self, *names: str) -> dict[str, NDArray[Any]]:
        """Return whole columns by name, each (N, ...), with fill values for missing blocks.

        Raises:
            StoreError: if one is damaged.
        """
        out = {name: _filled(self._arrays[f"episodes/{name}"], self.length) for name in names}
        loose = self.blocks()
        for segment in segments(self.path):
            if segment.is_in(loose) and self._take(segment, out):
                loose[segment.place] = False
        for start, stop in map(self.rows, np.flatnonzero(loose).tolist()):
            for name in names:
                out[name][start:stop] = self.read_rows(name, start, stop)
        return out

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

    def _take(self, segment: Segment, out: Mapping[str, NDArray[Any]]) -> bool:
        """Copy a segment's rows into the columns; return whether their types and shapes fit."""
        packed = segment.read([f"episodes/{name}" for name in out])
        size = self.config.block_size
        start, stop = segment.blocks.start * size, segment.blocks.stop * size
        places = [column[start:stop] for column in out.values()]
        values = list(packed.values()) if packed else []
        if [(v.dtype, v.shape) for v in values] != [(p.dtype, p.shape) for p in places]:
            return False
        for place, value in zip(places, values, strict=True):
            place[...] = value
        return True


def _filled(array: StoredArray, length: int) -> NDArray[Any]:
    whole = array.zarr
    return np.full((length, *whole.shape[1:]), whole.fill_value, whole.dtype)


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
