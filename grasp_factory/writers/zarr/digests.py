"""A checksum for each array of an episode: it shows which array or image is damaged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import google_crc32c
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.content_checksum import content_bytes


def digest(values: NDArray[Any]) -> int:
    """Return the CRC-32C of an episode's values of one array, unpadded."""
    return int(google_crc32c.value(bytes(content_bytes(values))))


def digests(contents: Mapping[str, NDArray[Any]], paths: Iterable[str]) -> NDArray[np.uint32]:
    """Return the CRC-32C of some arrays of an episode's contents, (A,), in the paths' order."""
    return np.array([digest(contents[path]) for path in paths], np.uint32)
