"""The checksum of an episode's contents, which depends on neither padding nor compression."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def checksum(contents: Mapping[str, NDArray[Any]]) -> str:
    """Return the SHA-256 (hex) of the names, types, shapes and bytes of an episode's contents.

    It does not depend on padding, chunking or compression.
    """
    digest = hashlib.sha256()
    for path, array in sorted(contents.items()):
        kind = "string" if array.dtype.kind == "U" else array.dtype.newbyteorder("<").str
        digest.update(f"{path} {kind} {array.shape}\n".encode())
        digest.update(content_bytes(array))
    return digest.hexdigest()


def content_bytes(array: NDArray[Any]) -> bytes | memoryview:
    """Return the bytes of an array of an episode's contents; strings are joined by NUL."""
    if array.dtype.kind == "U":
        return "\0".join(array.ravel().tolist()).encode()
    return np.ascontiguousarray(array).data
