"""Decode the small chunks of a column many at a time: a decoder's start costs more than 100 bytes.

One call of zstd decompresses frames one after another. Each header must give the right size before,
and zstd compares it with the content, so no chunk can take another one's place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numcodecs import zstd  # type: ignore[import-untyped]
from numpy.typing import NDArray

from grasp_factory.writers.zarr.chunks import COUNT_BYTES, content_size

RUN_BYTES = 2**20
"""A run ends with the chunk that makes it longer than this, compressed."""


def runs(
    files: Iterable[int], read: Callable[[int], bytes | None]
) -> Iterator[tuple[int, list[bytes]]]:
    """Yield runs of files: the number of the first one, and the content of each.

    Args:
        files: Numbers that follow one another.
        read: Returns the content of a file; None if it is missing, which ends a run.
    """
    first, run, size = 0, list[bytes](), 0
    for file in files:
        data = read(file)
        if run and (data is None or size > RUN_BYTES):
            yield first, run
            run, size = [], 0
        if data is not None:
            if not run:
                first = file
            run.append(data)
            size += len(data)
    if run:
        yield first, run


def unpack_run(chunks: Sequence[bytes], out: NDArray[Any]) -> None:
    """Decompress K chunks of numbers into ``out``, (K * M, ...), contiguous.

    Raises:
        ValueError, RuntimeError: if one is damaged; ``unpack`` tells which.
    """
    each = out.nbytes // len(chunks)
    for chunk in chunks:
        if content_size(chunk) != each:
            raise ValueError(f"a chunk of another size than {each} bytes")
    zstd.decompress(b"".join(chunks), out)


def unpack_run_of_equal_words(chunks: Sequence[bytes], count: int, width: int) -> NDArray[np.uint8]:
    """Return the bytes of K chunks of ``count`` words without empty ones, (K * count, width).

    Raises:
        ValueError, RuntimeError: if one is damaged, or a word has another number of bytes than
            ``width``; ``unpack_equal_words`` tells which, and takes empty words.
    """
    word = COUNT_BYTES + width
    whole = np.empty((len(chunks), COUNT_BYTES + count * word), np.uint8)
    unpack_run(chunks, whole)
    table = whole[:, COUNT_BYTES:].reshape(-1, word)
    if (_number(whole) != count).any() or (_number(table) != width).any():
        raise ValueError(f"a chunk without {count} words of {width} bytes")
    return table[:, COUNT_BYTES:]


def _number(rows: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return the number that each row (K, ...) begins with, (K, 1)."""
    return rows[:, :COUNT_BYTES].copy().view("<u4")
