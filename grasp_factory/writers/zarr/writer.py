"""The default writer: one block becomes one shard of every array of a Zarr store."""

from __future__ import annotations

import contextlib
import os
import random
import time
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
from grasp_factory.writers.zarr.block_attempt import (
    BlockAttempt,
    SupersededError,
    claimed_blocks,
    remove_attempts,
)
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
WAITS_S = tuple(min(0.05 * 1.5**k, 2.0) for k in range(16))
"""Longest waits before a block is tried again that another process is writing, seconds."""
_JITTER = random.SystemRandom()
"""Of the waits. It leaves the generators alone that a program may have seeded."""

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
        """Write all files aside, then give them their names, ``status`` last: it commits the block.

        Several processes may do this for one block: the files are those of one of them
        (``block_attempt``). Rows of the block that are not passed stay missing. If the block has
        all these rows already, nothing is written. See ``Writer.write_block``.

        Raises:
            StoreError: if the block has other episodes than ``rows``.
        """
        start = block * self.block_size
        room = min(self.block_size, self.length - start)
        if self._is_collected:
            check_count(block, rows, room)
        else:
            check_rows(block, rows, start, room)
        texts = texts_of(rows, fingerprints)
        values = [self._values(*row) for row in zip(rows, texts, strict=True)]
        for wait_s in WAITS_S:
            try:
                return self._attempt(block, values)
            except SupersededError:
                time.sleep(_JITTER.uniform(0.0, wait_s))
        raise StoreError(
            f"{self.path}: block {block} is written by other processes again and again: wait for"
            " them, then run the same command again"
        )

    def remove_leftovers(self) -> None:
        """Remove what lost processes have left of blocks. The caller holds the store's lock.

        Raises:
            StoreError: if that cannot be done.
        """
        try:
            for block in claimed_blocks(self._place / schema.STATUS.path):
                rows = self._rows_of(block)
                if rows:
                    is_complete = len(self.present(block)) == len(rows)
                    remove_attempts(*self._block_files(block), is_complete=is_complete)
        except OSError as error:
            raise StoreError(
                f"{self.path}: what is left of a block cannot be removed: {error.strerror}"
            ) from None

    def _attempt(self, block: int, values: Sequence[Values]) -> None:
        """Write a block, unless the store has it already.

        Raises:
            SupersededError: if another process does the same.
        """
        marker, files = self._block_files(block)
        with BlockAttempt(marker, files) as attempt:
            if self._holds(block, values):
                return
            for field in self._fields:
                self._stage(attempt, field, block, values)
            attempt.sync()
            attempt.check()
            if self._holds(block, values):
                return
            unpack_block(self._place, block)
            if marker.exists():  # readers then treat its uncommitted rows as pending
                _touch(marker.partial)
                fsync_places([marker.parent])
            attempt.publish()
            marker.partial.unlink(missing_ok=True)

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

    def _holds(self, block: int, values: Sequence[Values]) -> bool:
        """Return whether a block has these rows and no others.

        Raises:
            StoreError: if it has an episode that is not among them.
        """
        present, start = self.present(block), block * self.block_size
        same = 0
        for row, status in present.items():
            ours = values[row - start] if row - start < len(values) else {}
            is_same = self._is_stored(schema.CHECKSUM, row, ours)
            same += is_same and self._is_stored(schema.FINGERPRINT, row, ours)
            if status == COMMITTED and not is_same:
                raise StoreError(
                    f"{self.path}: block {block} was written with another episode {row} by another"
                    " process: a committed episode is not replaced; `grasp-factory verify` tells"
                    " whether the store is whole"
                )
        return same == len(values) == len(present)

    def _is_stored(self, column: Field, row: int, values: Values) -> bool:
        """Return whether the store has the value of a row in a column, or has no such column."""
        array = self._arrays.get(column.path)
        return array is None or read_array(array, slice(row, row + 1))[0] == values.get(column.path)

    def _stage(
        self, attempt: BlockAttempt, row: Field, block: int, values: Sequence[Values]
    ) -> None:
        """Write a field's files of a block aside."""
        files = self._files_of(row, block)
        if not row.is_video:
            attempt.stage(files[0], self._packed(row, [value.get(row.path) for value in values]))
            return
        for file, value in zip(files, values, strict=False):
            frames = value.get(row.path, ())
            if len(frames):
                room = self._arrays[row.path].shape[1]
                attempt.stage(file, packed_shard(list(frames), room, ZSTD_LEVEL))

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

    def _block_files(self, block: int) -> tuple[Place, list[Place]]:
        """Return the marker of a block and its other files."""
        data = [field for field in self._fields if field != schema.STATUS]
        files = [file for field in data for file in self._files_of(field, block)]
        return self._files_of(schema.STATUS, block)[0], files

    def _files_of(self, row: Field, block: int) -> list[Place]:
        return block_files(self._place, row, block, self._rows_of(block))

    def _rows_of(self, block: int) -> range:
        start = block * self.block_size
        return range(start, min(start + self.block_size, self.length))


def _padded(value: NDArray[Any] | None, room: tuple[int, ...], row: Field) -> NDArray[Any]:
    whole = np.full(room, row.fill, row.dtype)
    if value is not None:
        whole[: len(value)] = value
    return whole


def _touch(file: Place) -> None:
    with contextlib.suppress(FileExistsError):
        os.close(file.create())
