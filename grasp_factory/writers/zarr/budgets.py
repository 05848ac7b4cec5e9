"""What the metadata of a store may ask a reader for: rows, the bytes of a block and of a chunk.

A few bytes of metadata can claim any size, and a few bytes of zeros expand to gigabytes. Reading a
row takes at most as much memory as a block of episodes; ``core.limits`` has the limits.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import (
    BLOCK,
    CHUNK,
    CHUNK_ROWS,
    CHUNKS,
    COLUMN,
    ROWS,
    VARIABLE,
    WORD,
    WORDS,
)
from grasp_factory.core.place import Place
from grasp_factory.core.serialization import check, to_plain
from grasp_factory.core.text_format import size_text
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.layout import shapes

_MOST_JOINTS = 32
_WORD_BYTES = 16
"""What NumPy's strings of variable length take."""
_DECODED_WORD_BYTES = 64
"""What a word takes while its chunk is decoded: a text of Python, and a reference to it."""


def check_block_size(config: FactoryConfig) -> None:
    """Check that readers would accept the blocks of a new store.

    Raises:
        ConfigError: if they would not.
    """
    room = shapes(schema.expand(config), config, _MOST_JOINTS, 1).items()
    episode = sum(_field_bytes(field, shape) for field, shape in room if not field.is_video)
    video = sum(_field_bytes(field, shape) for field, shape in room if field.is_video)
    most = BLOCK.most
    valid = (
        f"up to {max(0, most - video) // episode} with these images, because readers accept blocks"
        f" of up to {size_text(most)}; {VARIABLE}=block=SIZE raises this limit for all commands"
    )
    fits = episode * config.block_size + video <= most
    check(fits, "block_size", config.block_size, valid)
    valid = (
        f"lower: a video would have up to {config.longest_video} frames, and readers accept"
        f" {CHUNKS.most}; {VARIABLE}=chunks=N raises this limit for all commands"
    )
    check(config.longest_video <= CHUNKS.most, "video_hz", config.video_hz, valid)
    size = len(json.dumps(to_plain(config.policy_parameters)).encode())
    valid = (
        f"JSON of up to {size_text(WORD.most // 2)}, because each recipe has a copy of it;"
        f" {VARIABLE}=word=SIZE raises this limit for all commands"
    )
    check(size <= WORD.most // 2, "policy_parameters", f"{size:,} bytes of JSON", valid)


def _field_bytes(field: schema.Field, shape: tuple[int, ...]) -> int:
    itemsize = _WORD_BYTES if field.dtype == "string" else np.dtype(field.dtype).itemsize
    return math.prod(shape) * itemsize


def check_arrays(store: Place, config: FactoryConfig, arrays: Iterable[zarr.Array[Any]]) -> None:
    """Check the sizes of a store's arrays before any of their values is read.

    Blocks are read as a whole, whatever the chunks are; of videos, one row.

    Raises:
        LimitError: naming the array, or the store, and the limit.
        StoreError: naming an array whose chunks have no size.
    """
    videos = {field.path for field in schema.expand(config) if field.is_video}
    block = 0
    for array in arrays:
        where = store.path / array.path
        whole = _whole(array, 1 if array.path in videos else config.block_size)
        CHUNK_ROWS.check((array.shards or array.chunks)[0], where)
        CHUNK.check(_chunk_bytes(array), where)
        CHUNKS.check(_pieces(whole, array.chunks, where), where)
        block += math.prod(whole) * array.dtype.itemsize
        if array.path == schema.STATUS.path:
            there = len((store / array.path).names())
            check_row_count(array.shape[0], there, config.block_size, store.path)
    BLOCK.check(block, store.path)


def check_whole(array: zarr.Array[Any], where: object) -> None:
    """Check the size of an array that is read as a whole.

    Raises:
        LimitError: naming the place, and the limit.
        StoreError: if its chunks have no size.
    """
    whole = _whole(array, array.shape[0] if array.ndim else 0)
    CHUNK.check(_chunk_bytes(array), where)
    CHUNKS.check(_pieces(whole, array.chunks, where), where)
    BLOCK.check(math.prod(whole) * array.dtype.itemsize, where)


def check_column(store: Place, array: zarr.Array[Any]) -> None:
    """Check the size of an array of all rows of a store, without the text of its words.

    Raises:
        LimitError: naming the array.
    """
    COLUMN.check(array.nbytes, store.path / array.path)


class TextBudget:
    """Counts the text of columns that are read together, while they are read."""

    def __init__(self, store: Place) -> None:
        """Begin to count, for columns of a store."""
        self._store, self._bytes = store, 0

    def count(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values of a column, whose words are counted.

        Raises:
            LimitError: if the text is too long.
        """
        if values.dtype.kind == "T":
            self.add(sum(len(word.encode()) for word in values.ravel().tolist()))
        return values

    def add(self, size: int) -> None:
        """Count bytes of text; see ``count``."""
        self._bytes += size
        WORDS.check(self._bytes, self._store.path)


def check_row_count(rows: int, blocks: int, block_size: int, where: object) -> None:
    """Check that a store does not claim many more rows than it has blocks for.

    Raises:
        LimitError: naming the place.
    """
    if rows > ROWS.usual and rows > 2 * blocks * block_size:
        ROWS.check(rows, where)


def _whole(array: zarr.Array[Any], rows: int) -> tuple[int, ...]:
    """Return the shape of so many rows with the files that hold them, which may be larger."""
    file = array.shards or array.chunks
    return tuple(map(max, (rows, *array.shape[1:]), file))


def _pieces(whole: tuple[int, ...], chunk: tuple[int, ...], where: object) -> int:
    if 0 in chunk:
        raise StoreError(f"{where}: chunks of {list(chunk)}, valid: sides of 1 or more")
    return math.prod(-(-size // part) for size, part in zip(whole, chunk, strict=True))


def _chunk_bytes(array: zarr.Array[Any]) -> int:
    """Return the bytes of a chunk; it may have more rows than the array."""
    is_text = array.dtype.kind == "T"
    return math.prod(array.chunks) * (_DECODED_WORD_BYTES if is_text else array.dtype.itemsize)
