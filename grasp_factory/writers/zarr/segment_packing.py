"""Pack the segments that are complete. Only the coordinator of a store does this."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.place import Place
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.column_segments import BYTES, FOLDER, WORDS, coded, segments
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.metadata_checksum import is_sealed
from grasp_factory.writers.zarr.placeholder import write_placeholder
from grasp_factory.writers.zarr.sizes import bytes_of_blocks

SEGMENT_BLOCKS = 1024
"""Blocks of a segment. Fewer blocks are not packed: one of their columns is read in 30 ms. A
million episodes have 122 segments."""
NOT_PACKED = ("checksum", "array_crc32c", "spec", "error")
"""Columns that are large and not used by filters."""
DESCRIPTION = "place of columns packed for reading; derived, may be deleted"


def pack(path: Path) -> None:
    """Pack every segment that is not packed yet and whose blocks are all complete.

    A segment whose blocks are damaged is skipped: their readers report the damage.

    Raises:
        StoreError: if the store is damaged, or a segment cannot be written.
    """
    columns = Columns.open(path)
    try:
        for leftover in (columns.place / FOLDER).glob(f"*.npz{PARTIAL}"):
            leftover.unlink()
        for blocks in _complete(columns):
            if members := _members(columns, blocks):
                _write(columns.place, blocks, members)
    except OSError as error:
        raise StoreError(f"{path / FOLDER} cannot be written: {error.strerror}") from None


def is_time_to_pack(index: int, block_size: int) -> bool:
    """Return whether a run that works block by block should pack when this episode begins.

    That is half a segment after a segment's end: by then all workers have committed its blocks.
    """
    rows = SEGMENT_BLOCKS * block_size
    return index % rows == rows // 2


def _complete(columns: Columns) -> Iterator[range]:
    """Yield the ranges of blocks to pack; all these blocks are present and complete."""
    loose = columns.blocks()
    for segment in segments(columns.place):
        loose[segment.place] = False
    whole = columns.length // columns.config.block_size
    for first in range(0, whole - SEGMENT_BLOCKS + 1, SEGMENT_BLOCKS):
        blocks = range(first, first + SEGMENT_BLOCKS)
        if loose[blocks.start : blocks.stop].all():
            yield blocks


def _members(columns: Columns, blocks: range) -> dict[str, NDArray[Any]]:
    """Return the members of a segment's file; no members if a row is missing or damaged."""
    names = [name for name in columns.names if name not in NOT_PACKED]
    rows = columns.rows(blocks.start)[0], columns.rows(blocks[-1])[1]
    try:
        values = {name: columns.read_rows(name, *rows) for name in names}
    except StoreError:
        return {}
    if (values["status"] == 0).any():
        return {}
    out: dict[str, NDArray[Any]] = {BYTES: np.asarray(bytes_of_blocks(columns, blocks), np.int64)}
    for name, column in values.items():
        path = f"episodes/{name}"
        if column.dtype.kind == "T":
            out[path], out[path + WORDS] = coded(column)
        else:
            out[path] = column
    return out


def _write(store: Place, blocks: range, members: dict[str, NDArray[Any]]) -> None:
    file = store / FOLDER / f"{blocks.start}-{blocks[-1]}.npz"
    if not is_sealed(store / FOLDER / "zarr.json"):
        write_placeholder(store, FOLDER, DESCRIPTION)
    content = io.BytesIO()
    np.savez(content, allow_pickle=False, **members)  # writes no dates: the same bytes each time
    with content.getbuffer() as data:
        file.write(data, durable=True)
