"""The split of an object, train, val or test: it depends on the object alone."""

from __future__ import annotations

import hashlib

SPLITS = ("train", "val", "test")
"""80, 10 and 10 % of all objects."""


def split_of(key: str) -> str:
    """Return the split of the object that goes by a key; it stays when a set grows."""
    share = int.from_bytes(hashlib.sha256(key.encode()).digest()[:8]) / 2**64
    return "train" if share < 0.8 else "val" if share < 0.9 else "test"
