"""The columns of a store that a snapshot records, read segment by segment."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.dataset.snapshots.segments import ROW
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import ColumnFiles
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import SOURCES, open_store, recorded_arrays

_DIGITS, _MOST_STATUS = 64, 2
_RECIPES = ("seed", "index")
_NEEDED = {schema.STATUS.path, schema.CHECKSUM.path, schema.DIGESTS.path}


class StateColumns:
    """Status, recipe, checksum and digests of the rows of a store.

    Attributes:
        attributes: the root's attributes.
        arrays: paths of the arrays that have digests, in their order.
        length: number of rows.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store.
            StoreError: if it is damaged.
        """
        self._path = path
        root, config = open_store(path, mode="r")
        self.attributes: dict[str, Any] = root.attrs.asdict()
        self._recipes = _RECIPES if SOURCES in self.attributes else ()
        needed = _NEEDED | {f"episodes/{name}" for name in self._recipes}
        fields = {row.path: row for row in schema.expand(config) if row.path in needed}
        opened = open_arrays(root, config, fields, needed)
        self._columns = Columns(path, config, opened)
        self.length = self._columns.length
        digests = opened[schema.DIGESTS.path].zarr
        document = {"attributes": digests.attrs.asdict(), "shape": list(digests.shape)}
        self.arrays = recorded_arrays(document)
        if not self.arrays:
            what = f"{schema.DIGESTS.path} does not name its arrays"
            raise StoreError(f"{path} is damaged: {what}; run grasp-factory verify on it")
        self._seed, self._checksum = config.seed, opened[schema.CHECKSUM.path]
        self._status = self._columns.read("status")["status"]
        if (self._status > _MOST_STATUS).any():
            raise self._damaged("status", 0)

    def rows(self, start: int, stop: int) -> NDArray[np.void]:
        """Return rows ``start`` to ``stop`` - 1, of ``segments.ROW``.

        Raises:
            StoreError: if they are damaged.
        """
        out = np.zeros(stop - start, ROW)
        if self._are_missing(start, stop):
            return out
        out["index"], out["seed"] = np.arange(start, stop), self._seed
        for name in self._recipes:
            out[name] = self._columns.read_rows(name, start, stop)
        out["status"] = self._status[start:stop]
        there = np.flatnonzero(out["status"])
        out["checksum"][there] = self._checksums(start, stop)[there]
        out[out["status"] == 0] = np.zeros((), ROW)
        return out

    def digests(self, start: int, stop: int) -> NDArray[np.uint32]:
        """Return the CRC-32C of each array of rows ``start`` to ``stop`` - 1, (K, A).

        Raises:
            StoreError: if they are damaged.
        """
        if self._are_missing(start, stop):
            return np.zeros((stop - start, len(self.arrays)), "<u4")
        return self._columns.read_rows("array_crc32c", start, stop).astype("<u4", copy=False)

    def _are_missing(self, start: int, stop: int) -> bool:
        """Return whether no row is there, so that nothing has to be read."""
        return not self._status[start:stop].any()

    def _checksums(self, start: int, stop: int) -> NDArray[np.uint8]:
        """Return the checksums of some rows, (K, 32); zeros for those of missing rows."""
        column = self._checksum
        if isinstance(column, ColumnFiles):
            text = column.read_equal_words(start, stop, _DIGITS)
        else:
            words = column.read(start, stop).astype(f"S{_DIGITS + 1}")
            text = np.zeros((stop - start, _DIGITS), np.uint8)
            whole = np.char.str_len(words) == _DIGITS
            text[whole] = words[whole].view(np.uint8).reshape(-1, _DIGITS + 1)[:, :_DIGITS]
        missing = text[:, 0] == 0
        text[missing] = ord("0")
        if missing[self._status[start:stop] != 0].any():
            raise self._damaged("checksum", start)
        try:
            found = bytes.fromhex(text.tobytes().decode("ascii"))
            return np.frombuffer(found, np.uint8).reshape(len(text), -1)
        except ValueError:
            raise self._damaged("checksum", start) from None

    def _damaged(self, column: str, start: int) -> StoreError:
        what = f"{column} of the rows from {start} on"
        return StoreError(f"{self._path} is damaged: {what}; run grasp-factory verify on it")
