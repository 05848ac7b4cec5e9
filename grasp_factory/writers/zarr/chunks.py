"""Decode chunks of the store's own layout without Zarr, whose overhead exceeds the decoding time.

Damaged bytes raise any exception of the decoders, or decode to other values; they never write
outside of the array that is filled.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import compress
from typing import Any, Self

import google_crc32c
import numpy as np
from numcodecs import zstd  # type: ignore[import-untyped]
from numcodecs.vlen import VLenUTF8  # type: ignore[import-untyped]
from numpy.typing import NDArray

from grasp_factory.core.limits import WORD
from grasp_factory.core.place import Place

ABSENT = 2**64 - 1
"""Offset and length, in a shard's index, of a chunk that was never written."""
_CHECKSUM_BYTES = 4
_MOST_HEADER_BYTES = 18
"""Of a frame (RFC 8878, 3.1.1)."""
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
VLEN = VLenUTF8()
COUNT_BYTES = 4
"""Bytes of the number of words of a chunk, and of each word's number of bytes."""
MOST_BYTES = 64 * 2**20
"""Largest content of a chunk of words that is decoded."""


def most_bytes_of_words(count: int) -> int:
    """Return the most bytes of a chunk of so many words.

    This package writes names, and recipes of up to 20 kB. NumPy's strings of fixed length take
    four bytes for each character, so long words cost a reader much more than their bytes.
    """
    return min(MOST_BYTES, COUNT_BYTES + count * (COUNT_BYTES + WORD.most))


def unpack(data: bytes | memoryview, out: NDArray[Any]) -> None:
    """Decompress a chunk of numbers into ``out``, a contiguous array of its size."""
    size = content_size(data)
    if size not in (None, out.nbytes):
        raise ValueError(f"a chunk of {size} bytes, valid: {out.nbytes}")
    zstd.decompress(data, out)


def unpack_words(data: bytes, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return a chunk of words as an array of numpy's ``StringDType``."""
    count = int(np.prod(shape))
    size, most = content_size(data), most_bytes_of_words(count)
    if size is None or size > most:  # a few bytes may decompress to gigabytes
        got = f"a chunk of {size or 'unknown'} bytes of words"
        raise ValueError(f"{got}, valid: up to {most}; {WORD.advice}")
    content = zstd.decompress(data)
    if int.from_bytes(content[:4], "little") != count:
        raise ValueError(f"a chunk of another number of words than {count}")
    words: NDArray[Any] = VLEN.decode(content)
    return words.reshape(shape).astype(np.dtypes.StringDType())


def unpack_equal_words(data: bytes, count: int, width: int) -> NDArray[np.uint8]:
    """Return the bytes of a chunk of ``count`` words, (count, width); zeros for empty words.

    It is quicker than ``unpack_words`` if no word is empty.

    Raises:
        ValueError: if a word that is not empty has another number of bytes than ``width``.
    """
    size = content_size(data)
    if size is None or size > COUNT_BYTES + count * (COUNT_BYTES + width):
        raise ValueError(f"a chunk of {size or 'unknown'} bytes, valid: {count} words of {width}")
    content = zstd.decompress(data)
    if int.from_bytes(content[:COUNT_BYTES], "little") != count:
        raise ValueError(f"a chunk of another number of words than {count}")
    out = np.zeros((count, width), np.uint8)
    if len(content) == COUNT_BYTES + count * (COUNT_BYTES + width):
        table = np.frombuffer(content, np.uint8, offset=COUNT_BYTES).reshape(count, -1)
        if (table[:, :COUNT_BYTES].copy().view("<u4") == width).all():
            out[...] = table[:, COUNT_BYTES:]
            return out
    for row, word in zip(out, VLEN.decode(content), strict=True):
        if word:
            row[...] = np.frombuffer(word.encode(), np.uint8)
    return out


class ShardFile:
    """A shard file, opened for reading; its index is at the end, followed by a checksum of it."""

    def __init__(self, folder: Place, name: str, chunks: int) -> None:
        """Open a shard of ``chunks`` chunks, a file in a directory.

        Raises:
            OSError: if there is no such file.
            StoreError: if it is no regular file.
            ValueError: if its index does not match its checksum.
        """
        self._file = folder.open_parts(name)
        try:
            self._index = self._read_index(chunks)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def read(self, chunks: Sequence[int], out: Sequence[NDArray[Any]] | NDArray[Any]) -> list[bool]:
        """Decompress chunks, each into an array of ``out``; return which were ever written.

        Raises:
            ValueError: if one lies beyond the file's end, or has another size.
        """
        entries = [self._index[chunk] for chunk in chunks]
        is_there = [(offset, length) != (ABSENT, ABSENT) for offset, length in entries]
        wanted = list(compress(zip(entries, out, strict=True), is_there))
        for (offset, length), piece in wanted:
            if offset + length > self._data_bytes or length > _most_compressed(piece.nbytes):
                what = f"a chunk at {offset} of {length} bytes"
                raise ValueError(f"{what}, valid: {self._data_bytes}")
        parts = self._file.several([(offset, length) for (offset, length), _ in wanted])
        for k, data in parts:
            unpack(data, wanted[k][1])
        return is_there

    def chunk_lengths(self, chunk_bytes: int) -> NDArray[np.uint64]:
        """Return the bytes of each chunk that is there, compressed, (K,).

        Raises:
            ValueError: unless the first K chunks are there, one directly after another from the
                file's start on, and none is longer than a chunk of ``chunk_bytes`` can be.
        """
        index = np.array(self._index, np.uint64)
        there = int((index != ABSENT).any(axis=1).sum())
        start, length = index[:there, 0], index[:there, 1]
        is_bounded = not there or int(length.max()) <= _most_compressed(chunk_bytes)
        ends = np.cumsum(length) if is_bounded else length
        if (
            not is_bounded
            or (index[there:] != ABSENT).any()
            or (start != ends - length).any()
            or (int(ends[-1]) if there else 0) != self._data_bytes
        ):
            raise ValueError("a shard whose chunks do not follow one another")
        return length

    def parts(self, size: int) -> Iterator[bytes]:
        """Yield the bytes of all chunks, in parts of up to ``size``.

        Raises:
            ValueError: if the file has become shorter.
        """
        for start in range(0, self._data_bytes, size):
            length = min(size, self._data_bytes - start)
            part = self._file.read(length, start)
            if len(part) != length:
                raise ValueError("a shard that has become shorter")
            yield part

    def _read_index(self, chunks: int) -> list[list[int]]:
        length = 16 * chunks + _CHECKSUM_BYTES
        tail = self._file.tail(length)
        self._data_bytes = self._file.size - length
        if self._data_bytes < 0:
            raise ValueError(f"a shard without an index of {length} bytes")
        index, stored = tail[:-_CHECKSUM_BYTES], tail[-_CHECKSUM_BYTES:]
        if google_crc32c.value(index) != int.from_bytes(stored, "little"):
            raise ValueError("a shard whose index does not match its checksum")
        return np.frombuffer(index, "<u8").reshape(chunks, 2).tolist()


def _most_compressed(size: int) -> int:
    """Return the most bytes that zstd needs for so many (``ZSTD_COMPRESSBOUND``)."""
    return size + (size >> 8) + (1 << 17)


def content_size(data: bytes | memoryview) -> int | None:
    """Return the content size in a zstd frame's header (RFC 8878, 3.1.1.1); None if it has none.

    The decoder accepts content smaller than ``out``, and would leave the rest of it as it is.
    """
    frame = bytes(data[:_MOST_HEADER_BYTES])
    if len(frame) < 6 or not frame.startswith(_ZSTD_MAGIC):
        raise ValueError("a chunk that is not zstd")
    descriptor = frame[4]
    is_single, size_flag = descriptor >> 5 & 1, descriptor >> 6
    width = (is_single, 2, 4, 8)[size_flag]
    if not width:
        return None
    start = 5 + (not is_single) + (0, 1, 2, 4)[descriptor & 3]
    # A field of two bytes holds the size minus 256: smaller sizes have a field of one byte.
    return int.from_bytes(frame[start : start + width], "little") + (256 if width == 2 else 0)
