"""The split of an object, train, val or test; it depends only on the object."""

from __future__ import annotations

import hashlib

SPLITS = ("train", "val", "test")
TRAIN_SHARE = 0.8
VAL_SHARE = 0.1
"""Shares of all objects; the rest is ``test``."""


def split_of(key: str) -> str:
    """Return the split of the object with this key; it does not change when a set grows."""
    share = int.from_bytes(hashlib.sha256(key.encode()).digest()[:8]) / 2**64
    if share < TRAIN_SHARE:
        return "train"
    return "val" if share < TRAIN_SHARE + VAL_SHARE else "test"
