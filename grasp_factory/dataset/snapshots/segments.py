"""Segments of a snapshot: the identity and the checksums of 1,024 consecutive rows, in two files.

The rows' file has ``ROW`` records. The digests' file has the CRC-32C of each array of each row,
(K, A), little-endian. Both are named by the SHA-256 of their bytes, so that snapshots share them.
"""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from grasp_factory.errors import StoreError

ROWS = 1024
"""Rows of a segment; the last one of a store may have fewer."""
ROW = np.dtype(
    [("index", "<i8"), ("seed", "<i8"), ("checksum", "u1", (32,)), ("status", "u1")]
)  # fmt: skip
"""A row of a store: its recipe's index and seed, the SHA-256 of its contents, and its status."""
DIGEST = np.dtype("<u4")
_MOST_STATUS = 2


def name_of(data: bytes) -> str:
    """Return the name of a segment's file: the SHA-256 of its bytes."""
    return hashlib.sha256(data).hexdigest()


def count(rows: int) -> int:
    """Return how many segments so many rows have."""
    return -(-rows // ROWS)


def span(k: int, rows: int) -> tuple[int, int]:
    """Return the first row of segment ``k``, and the one after its last."""
    return k * ROWS, min((k + 1) * ROWS, rows)


def decoded_rows(data: bytes, where: str) -> NDArray[np.void]:
    """Return the rows of a segment's file of the right size, (K,) of ``ROW``.

    Raises:
        StoreError: if a status is no status, or a missing row has a content.
    """
    rows = np.frombuffer(data, ROW)
    missing = rows["status"] == 0
    if (rows["status"] > _MOST_STATUS).any() or rows["checksum"][missing].any():
        raise StoreError(f"{where} is damaged: it is no segment of a snapshot")
    return rows
