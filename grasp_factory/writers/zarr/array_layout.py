"""Which reader an array of a store has: the fast one of this package's own layout, or Zarr."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import (
    BytesCodec,
    Crc32cCodec,
    ShardingCodec,
    VLenUTF8Codec,
    ZstdCodec,
)
from zarr.core.chunk_key_encodings import V2ChunkKeyEncoding
from zarr.core.metadata import ArrayV3Metadata

from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import ColumnFiles, ShardFiles, StoredArray
from grasp_factory.writers.zarr.header import read_array

_LITTLE = BytesCodec(endian="little")
_NUMBERS = (BytesCodec(endian=None), _LITTLE)
_SHARD = ShardingCodec(
    chunk_shape=(1,), index_codecs=(_LITTLE, Crc32cCodec()), index_location="end"
)
"""Codecs to compare with. Their settings are enums in zarr 3.1, and strings in newer versions."""


def stored(array: zarr.Array[Any]) -> StoredArray:
    """Return the fastest reader for an array."""
    metadata, shape = array.metadata, array.shape
    if not isinstance(metadata, ArrayV3Metadata) or not _has_our_keys(metadata):
        return ThroughZarr(array)
    match metadata.codecs:
        case (BytesCodec() | VLenUTF8Codec() as values, ZstdCodec()) if (
            values in _NUMBERS or isinstance(values, VLenUTF8Codec)
        ) and array.chunks[1:] == shape[1:]:
            return ColumnFiles(array)
        case (ShardingCodec(codecs=(BytesCodec() as values, ZstdCodec())) as shard,) if (
            values in _NUMBERS
            and _index(shard) == _index(_SHARD)
            and array.shards
            and array.shards[1:] == shape[1:]
            and _has_whole_pieces(array)
        ):
            return ShardFiles(array)
    return ThroughZarr(array)


def _index(shard: ShardingCodec) -> tuple[Any, Any]:
    """Return how the index of a shard is stored, and where."""
    return shard.index_codecs, shard.index_location


def _has_our_keys(metadata: ArrayV3Metadata) -> bool:
    """Return whether chunks have this package's names, and numbers this machine's byte order."""
    keys = metadata.chunk_key_encoding
    return sys.byteorder == "little" and keys == V2ChunkKeyEncoding(separator=".")


def _has_whole_pieces(array: zarr.Array[Any]) -> bool:
    """Return whether a chunk is an episode's values, or those of one of its frames."""
    return array.chunks in [(1, *array.shape[1:]), (1, 1, *array.shape[2:])]


class ThroughZarr(StoredArray):
    """Reads any layout, such as that of a store which another tool has rewritten."""

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """See ``StoredArray.read``."""
        values = read_array(self.zarr, slice(start, stop))
        if len(values) != stop - start:
            what = f"{self.zarr.path} has {self.zarr.shape[0]} rows, and no row {stop - 1}"
            raise StoreError(f"{self.zarr.store} is damaged, or growing just now: {what}")
        return values

    def read_frames(self, rows: Sequence[int], frame: int) -> NDArray[Any]:
        """See ``StoredArray.read_frames``."""
        out = np.empty((len(rows), *self.zarr.shape[2:]), self.zarr.dtype)
        for k, row in enumerate(rows):
            out[k] = read_array(self.zarr, slice(row, row + 1), frame)[0]
        return out
