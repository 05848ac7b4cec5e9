"""Arrays of a store, read by rows, directly from the files that this package writes."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
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

from grasp_factory.core.limits import CHUNK
from grasp_factory.errors import NO_DAMAGE, StoreError
from grasp_factory.writers.zarr.chunks import ShardFile, unpack, unpack_equal_words, unpack_words
from grasp_factory.writers.zarr.header import first_line, place_in, read_array


class StoredArray(ABC):
    """An array of a store whose first dimension is the episodes; missing rows have the fill value.

    Attributes:
        zarr: the array as Zarr opened it.
    """

    def __init__(self, array: zarr.Array[Any]) -> None:
        self.zarr = array

    @abstractmethod
    def read(self, start: int, stop: int) -> NDArray[Any]:
        """Return rows ``start`` to ``stop`` - 1, (stop - start, ...).

        Raises:
            StoreError: naming them, if they are damaged.
        """

    def read_frames(self, rows: Sequence[int], frame: int) -> NDArray[Any]:
        """Return the values at ``frame`` of the second dimension, (K, ...), in the order of rows.

        Raises:
            StoreError: naming the row, if one is damaged.
        """
        out = np.empty((len(rows), *self.zarr.shape[2:]), self.zarr.dtype)
        for k, row in enumerate(rows):
            out[k] = self.read(row, row + 1)[0, frame]
        return out

    def gather(self, rows: NDArray[np.int64], block_size: int) -> NDArray[Any]:
        """Return the values of K rows, (K, ...), in their order; one read for each block.

        Args:
            rows: from 0, in any order, (K,).
            block_size: rows of a block.

        Raises:
            StoreError: naming the rows, if some are damaged.
        """
        out = np.empty((len(rows), *self.zarr.shape[1:]), self.zarr.dtype)
        for places in by_block(rows, block_size):
            wanted = rows[places]
            first = int(wanted.min())
            out[places] = self.read(first, int(wanted.max()) + 1)[wanted - first]
        return out


def by_block(rows: NDArray[np.int64], block_size: int) -> list[NDArray[np.intp]]:
    """Return, for each block among K rows, the indices of its rows among them.

    Blocks are in the order of their first rows among the K; rows of a block keep their order.
    """
    if not len(rows):
        return []
    blocks = rows // block_size
    order = np.argsort(blocks, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(blocks[order])) + 1)
    return sorted(groups, key=lambda group: int(group[0]))


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


class _OurFiles(StoredArray, ABC):
    """Files of a fixed number of rows, named by number with a 0 for each further dimension."""

    def __init__(self, array: zarr.Array[Any], rows: int) -> None:
        super().__init__(array)
        self._folder, self._tail = place_in(array), ".0" * (array.ndim - 1)
        self._file_rows = rows
        self._dtype, self._shape = array.dtype, array.shape[1:]
        self._fill = array.fill_value

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """See ``StoredArray.read``."""
        size = self._file_rows
        out = np.empty((max(stop - start, 0), *self._shape), self._dtype)
        for file in range(start // size, -(-stop // size)) if start < stop else ():
            first, last = max(start, file * size), min(stop, (file + 1) * size)
            try:
                self._read_file(file, first - file * size, out[first - start : last - start])
            except Exception as error:
                raise self._named(error, first, last) from None
        return out

    @abstractmethod
    def _read_file(self, file: int, first: int, out: NDArray[Any]) -> None:
        """Fill ``out`` with rows of a file, from its row ``first`` on."""

    def _name(self, number: int) -> str:
        return f"{number}{self._tail}"

    def _named(self, error: Exception, start: int, stop: int) -> Exception:
        """Return the error to raise; decoders raise many types for damaged bytes."""
        if isinstance(error, NO_DAMAGE):
            return error
        array = self.zarr
        what = f"{array.path} of episodes {start} to {stop - 1} cannot be read"
        return StoreError(f"{array.store}: {what}: {first_line(error)}")


class ColumnFiles(_OurFiles):
    """Reads files of one chunk each."""

    def __init__(self, array: zarr.Array[Any]) -> None:
        super().__init__(array, array.chunks[0])
        self._is_text = array.dtype.kind == "T"
        self._chunk = array.chunks

    def _read_file(self, file: int, first: int, out: NDArray[Any]) -> None:
        try:
            data = self._folder.read_file(self._name(file), CHUNK)
        except FileNotFoundError:
            out[...] = self._fill
            return
        if self._is_text:
            whole = unpack_words(data, self._chunk)
        else:
            whole = np.empty(self._chunk, self._dtype)
            unpack(data, whole)
        out[...] = whole[first : first + len(out)]

    def read_equal_words(self, start: int, stop: int, width: int) -> NDArray[np.uint8]:
        """Return the bytes of words of a column, (stop - start, width); zeros for empty words.

        Raises:
            StoreError: naming the rows, if they are damaged, or have words of another length.
        """
        size, count = self._file_rows, self._chunk[0]
        out = np.zeros((stop - start, width), np.uint8)
        for file in range(start // size, -(-stop // size)):
            first, last = max(start, file * size), min(stop, (file + 1) * size)
            try:
                data = self._folder.read_file(self._name(file), CHUNK)
                words = unpack_equal_words(data, count, width)
            except FileNotFoundError:
                continue
            except Exception as error:
                raise self._named(error, first, last) from None
            out[first - start : last - start] = words[first - file * size : last - file * size]
        return out


class ShardFiles(_OurFiles):
    """Reads files of many chunks: one for each episode, or for each of its frames."""

    def __init__(self, array: zarr.Array[Any]) -> None:
        assert array.shards
        super().__init__(array, array.shards[0])
        self._pieces = array.shape[1] // array.chunks[1] if array.ndim > 1 else 1
        """Number of chunks of an episode."""

    def read_frames(self, rows: Sequence[int], frame: int) -> NDArray[Any]:
        """See ``StoredArray.read_frames``. Opens each file once, and unpacks no other frames."""
        if self._pieces != self._shape[0]:  # a chunk holds all of an episode
            return super().read_frames(rows, frame)
        out = np.empty((len(rows), *self._shape[1:]), self._dtype)
        size, wanted = self._file_rows, np.asarray(rows, np.int64)
        for places in by_block(wanted, size):
            within = wanted[places]
            numbers = (within % size * self._pieces + frame).tolist()
            try:
                self._read_pieces(int(within[0]) // size, numbers, [out[k] for k in places])
            except Exception as error:
                raise self._named(error, int(within.min()), int(within.max()) + 1) from None
        return out

    def _read_file(self, file: int, first: int, out: NDArray[Any]) -> None:
        count = self._pieces
        pieces = out.reshape(len(out) * count, -1)
        self._read_pieces(file, range(first * count, first * count + len(pieces)), pieces)

    def _read_pieces(
        self, file: int, numbers: Sequence[int], out: Sequence[NDArray[Any]] | NDArray[Any]
    ) -> None:
        try:
            chunks = self._file_rows * self._pieces
            with ShardFile(self._folder, self._name(file), chunks) as shard:
                for is_there, piece in zip(shard.read(numbers, out), out, strict=True):
                    if not is_there:
                        piece[...] = self._fill
        except FileNotFoundError:
            for piece in out:
                piece[...] = self._fill
