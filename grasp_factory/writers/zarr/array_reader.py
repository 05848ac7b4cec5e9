"""Arrays of a store, read by rows, directly from the files that this package writes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core.limits import CHUNK
from grasp_factory.errors import NO_DAMAGE, StoreError
from grasp_factory.writers.zarr.chunk_runs import runs, unpack_run, unpack_run_of_equal_words
from grasp_factory.writers.zarr.chunks import ShardFile, unpack, unpack_equal_words, unpack_words
from grasp_factory.writers.zarr.header import first_line, place_in


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
    if len(rows) == 1 or (blocks == blocks[0]).all():
        return [np.arange(len(rows))]
    order = np.argsort(blocks, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(blocks[order])) + 1)
    return sorted(groups, key=lambda group: int(group[0]))


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

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """See ``StoredArray.read``. Whole files of numbers are decoded many at a time."""
        size = self._file_rows
        first, last = -(-start // size), stop // size
        if self._is_text or last - first < 2:
            return super().read(start, stop)
        out = np.full((stop - start, *self._shape), self._fill, self._dtype)
        out[: first * size - start] = super().read(start, first * size)
        out[last * size - start :] = super().read(last * size, stop)
        for file, chunks in runs(range(first, last), self._whole_content):
            row, end = file * size, (file + len(chunks)) * size
            rows = out[row - start : end - start]
            try:
                unpack_run(chunks, rows)
            except Exception:  # one after another, which names the rows of a damaged one
                rows[...] = super().read(row, end)
        return out

    def _content(self, file: int) -> bytes | None:
        """Return the content of a file; None if it is missing."""
        try:
            return self._folder.read_file(self._name(file), CHUNK)
        except FileNotFoundError:
            return None

    def _read_file(self, file: int, first: int, out: NDArray[Any]) -> None:
        data = self._content(file)
        if data is None:
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
        for file, chunks in runs(range(start // size, -(-stop // size)), self._whole_content):
            try:
                words = unpack_run_of_equal_words(chunks, count, width)
            except Exception:
                words = np.concatenate(
                    [self._equal_words(file + k, chunk, width) for k, chunk in enumerate(chunks)]
                )
            row = file * size
            first, last = max(start, row), min(stop, row + len(words))
            out[first - start : last - start] = words[first - row : last - row]
        return out

    def _equal_words(self, file: int, chunk: bytes, width: int) -> NDArray[np.uint8]:
        try:
            return unpack_equal_words(chunk, self._chunk[0], width)
        except Exception as error:
            raise self._of_file(error, file) from None

    def _whole_content(self, file: int) -> bytes | None:
        try:
            return self._content(file)
        except Exception as error:
            raise self._of_file(error, file) from None

    def _of_file(self, error: Exception, file: int) -> Exception:
        """Return the error to raise for all rows of a file."""
        return self._named(error, file * self._file_rows, (file + 1) * self._file_rows)


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
