"""Encode values as the bytes of the store's files; ``chunks`` and any Zarr library read them.

Zarr's own writer takes three times as long as the compression: it prepares each array again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import google_crc32c
import numpy as np
from numcodecs import zstd  # type: ignore[import-untyped]
from numpy.typing import NDArray

from grasp_factory.writers.zarr.chunks import ABSENT, VLEN


def packed_chunk(values: NDArray[Any], level: int) -> bytes:
    """Return one chunk of numbers or words, compressed with zstd."""
    if values.dtype.kind == "O":
        return bytes(zstd.compress(VLEN.encode(values), level))
    return bytes(zstd.compress(np.ascontiguousarray(values), level))


def packed_shard(pieces: Sequence[NDArray[Any]], chunks: int, level: int) -> bytes:
    """Return a shard of ``chunks`` chunks, of which ``pieces`` are the first; the rest are absent.

    After the chunks come the offset and length of each, and a CRC-32C of these.
    """
    index = np.full((chunks, 2), ABSENT, "<u8")
    packed = [packed_chunk(piece, level) for piece in pieces]
    lengths = [len(data) for data in packed]
    index[: len(packed), 0] = np.cumsum([0, *lengths[:-1]])
    index[: len(packed), 1] = lengths
    table = index.tobytes()
    return b"".join([*packed, table, google_crc32c.value(table).to_bytes(4, "little")])
