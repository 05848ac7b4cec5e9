"""Joining the blocks of a store to larger ones."""

from __future__ import annotations

import math

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.place import Place, fsync_places
from grasp_factory.core.schema import Field
from grasp_factory.curation.pack.source_layout import PackSource
from grasp_factory.dataset.row_reader import mending
from grasp_factory.errors import RefusedFileError, StoreError
from grasp_factory.writers.zarr.encoding import packed_chunk
from grasp_factory.writers.zarr.header import first_line
from grasp_factory.writers.zarr.layout import ZSTD_LEVEL, block_files
from grasp_factory.writers.zarr.shard_joining import join_shards


class BlockJoiner:
    """Writes blocks of a new store, each of several blocks of its source.

    The bytes are those that ``ZarrWriter`` writes for the same rows in blocks of the new size.
    """

    def __init__(self, source: PackSource, target: Place, config: FactoryConfig) -> None:
        """Use a source, the new store's directory, and its config."""
        self._source, self._target = source, target
        self._size = config.block_size
        self._each = source.config.block_size

    def rows(self, block: int) -> range:
        """Return the rows of a new block."""
        start = block * self._size
        return range(start, min(start + self._size, self._source.length))

    def join(self, block: int) -> None:
        """Write the files of a new block, durably, those of ``status`` last.

        Raises:
            StoreError: naming the array, if a source block is damaged.
            OSError: if the disk fails.
        """
        data = [f for f in self._source.fields.values() if f != schema.STATUS]
        for fields in (data, [schema.STATUS]):
            written = [file for field in fields for file in self._write(field, block)]
            fsync_places([*written, *(self._target / field.path for field in fields)])

    def _write(self, field: Field, block: int) -> list[Place]:
        rows = self.rows(block)
        files = block_files(self._target, field, block, rows)
        try:
            if field.is_video:
                return self._copy_videos(field, rows, files)
            if field.is_image or field.length_column:
                self._join_shards(field, rows, files[0])
            else:
                files[0].write(self._column(field, rows))
        except (RefusedFileError, StoreError):
            raise
        except (ValueError, FileNotFoundError) as error:
            path = self._source.store.path
            what = f"{field.path} of rows {rows[0]} to {rows[-1]}: {first_line(error)}"
            raise StoreError(f"{path} is damaged: {what}; {mending(path)}") from None
        return files

    def _join_shards(self, field: Field, rows: range, target: Place) -> None:
        shape = self._source.arrays[field.path].zarr.shape[1:]
        pieces = shape[0] if field.is_image else 1
        blocks = range(rows[0] // self._each, rows[-1] // self._each + 1)
        sources = [block_files(self._source.place, field, b, range(0))[0] for b in blocks]
        join_shards(
            sources,
            target,
            chunks=self._each * pieces,
            room=self._size * pieces,
            chunk_bytes=math.prod(shape) // pieces * np.dtype(field.dtype).itemsize,
        )

    def _copy_videos(self, field: Field, rows: range, targets: list[Place]) -> list[Place]:
        frames, *image = self._source.arrays[field.path].zarr.shape[1:]
        size = math.prod(image) * np.dtype(field.dtype).itemsize
        written = []
        sources = block_files(self._source.place, field, 0, rows)
        for source, target in zip(sources, targets, strict=True):
            if source.exists():
                join_shards([source], target, chunks=frames, room=frames, chunk_bytes=size)
                written.append(target)
        return written

    def _column(self, field: Field, rows: range) -> bytes:
        values = self._source.arrays[field.path].read(rows.start, rows.stop)
        is_text = field.dtype == "string"
        dtype = object if is_text else field.dtype
        column = np.full((self._size, *values.shape[1:]), field.fill, dtype)
        column[: len(rows)] = values.tolist() if is_text else values
        return packed_chunk(column, ZSTD_LEVEL)
