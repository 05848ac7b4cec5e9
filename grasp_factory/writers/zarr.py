"""The default writer: one block becomes one shard of every array of a Zarr store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory import schema
from grasp_factory.episode import Episode
from grasp_factory.errors import StoreError
from grasp_factory.schema import Field
from grasp_factory.writers.base import Quarantined, Writer, check_rows
from grasp_factory.writers.files import fsync
from grasp_factory.writers.header import open_array, open_store
from grasp_factory.writers.layout import RUNTIME, files_of, shard_numbers

COMMITTED, QUARANTINED = 1, 2
_NOT_IN_AN_EPISODE = ("episodes/status", "episodes/checksum", "episodes/error")

Values = Mapping[str, NDArray[Any]]
"""One row of the store: array by path. What a path lacks is left at its fill value."""


class ZarrWriter(Writer):
    """Writes blocks into a store that ``prepare_store`` made. Creates and grows nothing.

    Attributes:
        block_size: episodes of a block.
        length: episodes that the store has room for; it may cut the last block short.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store of this version.
            StoreError: if it is damaged.
        """
        self.path = Path(path)
        root, config = open_store(self.path, mode="r+")
        self._fields = schema.expand(config)
        self._arrays = {
            row.path: open_array(root, row.path).with_config(RUNTIME) for row in self._fields
        }
        self.block_size = config.block_size
        self.length = self._arrays[schema.STATUS.path].shape[0]

    def write_block(self, block: int, rows: Sequence[Episode | Quarantined]) -> None:
        """Clear the block, write array by array, then ``status``, which commits it.

        Rows of the block that are not given stay missing. See ``Writer.write_block``.
        """
        start = block * self.block_size
        check_rows(block, rows, start, min(self.block_size, self.length - start))
        values = [self._values(row) for row in rows]
        self._clear(block)
        data = [field for field in self._fields if field != schema.STATUS]
        for field in data:
            self._write(field, start, values)
        fsync(self._files(block, data))
        self._write(schema.STATUS, start, values)
        fsync(self._files(block, [schema.STATUS]))

    def _values(self, row: Episode | Quarantined) -> Values:
        if isinstance(row, Quarantined):
            return {
                "episodes/status": np.asarray(QUARANTINED),
                "episodes/spec": np.asarray(row.spec.to_json()),
                "episodes/error": np.asarray(row.reason.encode(errors="replace").decode()),
            }
        contents = row.contents()
        self._check_fits(f"episode {row.spec.index}", contents)
        return contents | {
            "episodes/status": np.asarray(COMMITTED),
            "episodes/checksum": np.asarray(row.checksum()),
        }

    def _check_fits(self, who: str, contents: Values) -> None:
        fields = {row.path: row for row in self._fields if row.path not in _NOT_IN_AN_EPISODE}
        for path in (*fields, *contents):
            if path not in contents:
                raise StoreError(f"{who}: {path} is missing")
            if path not in fields:
                raise StoreError(f"{who}: {path} has no array in the store")
        for path, row in fields.items():
            got, room = contents[path], self._arrays[path].shape[1:]
            kind = "string" if got.dtype.kind == "U" else got.dtype.name
            if row.length_column:
                room = (min(int(contents[row.length_column]), room[0]), *room[1:])
            if (kind, got.shape) != (row.dtype, room):
                raise StoreError(
                    f"{who}: {path}: got {kind} {got.shape}, valid: {row.dtype} {room}"
                )

    def _clear(self, block: int) -> None:
        markers = self.path / schema.STATUS.path
        committed = self._files_of(schema.STATUS, block)
        for file in committed:
            file.unlink()
        if committed:  # durable before the data goes: a power cut must not leave the marker alone
            fsync([markers])
        for row in self._fields:
            for file in self._files_of(row, block):
                file.unlink()

    def _write(self, row: Field, start: int, values: Sequence[Values]) -> None:
        array = self._arrays[row.path]
        if row.is_video:
            for i, value in enumerate(values, start):
                if len(value.get(row.path, ())):
                    array[i, : len(value[row.path])] = value[row.path]
            return
        stop = min(start + self.block_size, self.length)
        dtype = np.dtypes.StringDType() if row.dtype == "string" else np.dtype(row.dtype)
        whole = np.full((stop - start, *array.shape[1:]), row.fill, dtype)
        for i, value in enumerate(values):
            if row.path not in value:
                continue
            if row.length_column:
                whole[i, : len(value[row.path])] = value[row.path]
            else:
                whole[i] = value[row.path]
        array[start:stop] = whole

    def _files(self, block: int, fields: Sequence[Field]) -> Iterator[Path]:
        for row in fields:
            yield from self._files_of(row, block)
            yield self.path / row.path

    def _files_of(self, row: Field, block: int) -> list[Path]:
        start = block * self.block_size
        rows = range(start, min(start + self.block_size, self.length))
        return files_of(self.path / row.path, shard_numbers(row, block, rows))
