"""The default writer: one block becomes one shard of every array of a Zarr store."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.episode import Episode
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.core.schema import Field
from grasp_factory.errors import StoreError
from grasp_factory.writers.base import Quarantined, Writer, check_count, check_rows, texts_of
from grasp_factory.writers.zarr.column_segments import unpack_block
from grasp_factory.writers.zarr.digests import digests
from grasp_factory.writers.zarr.encoding import packed_chunk, packed_shard
from grasp_factory.writers.zarr.header import (
    SOURCES,
    fields_of,
    open_array,
    open_store,
    place_in,
    read_array,
)
from grasp_factory.writers.zarr.layout import ZSTD_LEVEL, block_files

MISSING, COMMITTED, QUARANTINED = range(3)
"""Values of the column ``status``."""

Values = Mapping[str, NDArray[Any]]
"""One row of the store: array by path. A path that is missing gets the fill value."""


class ZarrWriter(Writer):
    """Writes blocks into a store that ``prepare_store`` created; it never creates or grows one.

    Attributes:
        block_size: episodes of a block.
        length: episodes that the store has room for; the last block may be shorter.
    """

    def __init__(self, path: Path) -> None:
        """Open the store at ``path``.

        Raises:
            StoreMismatchError: if there is no store of this version.
            StoreError: if it is damaged.
        """
        self.path = Path(path)
        root, config = open_store(self.path, mode="r+")
        self._place = place_in(root)
        self._fields = tuple(fields_of(self.path, config, root.attrs.asdict()).values())
        self._digested = schema.digested(self._fields)
        self._arrays = {row.path: open_array(root, row.path) for row in self._fields}
        self._is_collected = SOURCES in root.attrs
        self.block_size = config.block_size
        self.length = self._arrays[schema.STATUS.path].shape[0]

    def write_block(
        self,
        block: int,
        rows: Sequence[Episode | Quarantined],
        fingerprints: Sequence[str] = (),
    ) -> None:
        """Write array by array, then ``status``, which commits the block.

        An existing block is cleared first, unless ``rows`` contains all its episodes unchanged:
        then its files are replaced one by one, and no episode is lost meanwhile. Rows of the block
        that are not passed stay missing. See ``Writer.write_block``.
        """
        start = block * self.block_size
        room = min(self.block_size, self.length - start)
        if self._is_collected:
            check_count(block, rows, room)
        else:
            check_rows(block, rows, start, room)
        texts = texts_of(rows, fingerprints)
        values = [self._values(*row) for row in zip(rows, texts, strict=True)]
        unpack_block(self._place, block)
        if self._keeps(block, values):
            self._mark(block)
        else:
            self._clear(block)
        data = [field for field in self._fields if field != schema.STATUS]
        for fields in (data, [schema.STATUS]):
            written = [file for field in fields for file in self._write(field, block, values)]
            fsync_places([*written, *(self._place / field.path for field in fields)])

    def _values(self, row: Episode | Quarantined, fingerprint: str) -> Values:
        contents = row.contents()
        values = contents | {
            schema.CHECKSUM.path: np.asarray(checksum(contents)),
            schema.FINGERPRINT.path: np.asarray(fingerprint),
        }
        if isinstance(row, Quarantined):
            return values | {schema.STATUS.path: np.asarray(QUARANTINED)}
        self._check_fits(f"episode {row.spec.index}", contents)
        return values | {
            schema.STATUS.path: np.asarray(COMMITTED),
            schema.DIGESTS.path: digests(contents, self._digested),
        }

    def _check_fits(self, who: str, contents: Values) -> None:
        fields = {row.path: row for row in self._fields if row.path in self._digested}
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

    def present(self, block: int) -> dict[int, int]:
        """Return the status of each row of a block that is committed or quarantined, by row number.

        Raises:
            StoreError: if it is damaged.
        """
        if not self._files_of(schema.STATUS, block)[0].exists():
            return {}
        start = block * self.block_size
        rows = slice(start, min(start + self.block_size, self.length))
        status = read_array(self._arrays[schema.STATUS.path], rows).tolist()
        return {start + k: code for k, code in enumerate(status) if code}

    def _keeps(self, block: int, values: Sequence[Values]) -> bool:
        """Return whether a block exists, and these rows contain all its episodes unchanged."""
        present, start = self.present(block), block * self.block_size
        episodes = [row for row, status in present.items() if status == COMMITTED]
        for row in episodes:
            stored = read_array(self._arrays[schema.CHECKSUM.path], slice(row, row + 1))[0]
            if row - start >= len(values) or values[row - start][schema.CHECKSUM.path] != stored:
                return False
        return bool(present)

    def _mark(self, block: int) -> None:
        """Mark the block as being rewritten, so that readers treat uncommitted rows as pending."""
        for row in self._fields:
            for file in self._files_of(row, block):
                file.partial.unlink(missing_ok=True)
        marker = self._files_of(schema.STATUS, block)[0]
        os.close(marker.partial.create())
        fsync_places([marker.parent])

    def _clear(self, block: int) -> None:
        marker = self._files_of(schema.STATUS, block)[0]
        if marker.exists():
            marker.unlink()
            # Durable before the data is removed: a power cut must not leave only the marker.
            fsync_places([marker.parent])
        for row in self._fields:
            for file in self._files_of(row, block):
                file.unlink(missing_ok=True)
                file.partial.unlink(missing_ok=True)

    def _write(self, row: Field, block: int, values: Sequence[Values]) -> list[Place]:
        """Write a field's files of a block and return them."""
        files = self._files_of(row, block)
        if not row.is_video:
            files[0].write(self._packed(row, [value.get(row.path) for value in values]))
            return files
        written = []
        for file, value in zip(files, values, strict=False):
            frames = value.get(row.path, ())
            if len(frames):
                room = self._arrays[row.path].shape[1]
                file.write(packed_shard(list(frames), room, ZSTD_LEVEL))
                written.append(file)
        return written

    def _packed(self, row: Field, values: Sequence[NDArray[Any] | None]) -> bytes:
        """Return the bytes of a block; missing values and the padding are the fill value."""
        room = self._arrays[row.path].shape[1:]
        if row.is_image:
            nothing = np.full(room, row.fill, row.dtype)
            frames = [f for value in values for f in (nothing if value is None else value)]
            return packed_shard(frames, self.block_size * room[0], ZSTD_LEVEL)
        if row.length_column:
            series = [_padded(value, room, row) for value in values]
            return packed_shard(series, self.block_size, ZSTD_LEVEL)
        is_text = row.dtype == "string"
        column = np.full((self.block_size, *room), row.fill, object if is_text else row.dtype)
        for i, value in enumerate(values):
            if value is not None:
                column[i] = value.tolist() if is_text else value
        return packed_chunk(column, ZSTD_LEVEL)

    def _files_of(self, row: Field, block: int) -> list[Place]:
        start = block * self.block_size
        rows = range(start, min(start + self.block_size, self.length))
        return block_files(self._place, row, block, rows)


def _padded(value: NDArray[Any] | None, room: tuple[int, ...], row: Field) -> NDArray[Any]:
    whole = np.full(room, row.fill, row.dtype)
    if value is not None:
        whole[: len(value)] = value
    return whole
