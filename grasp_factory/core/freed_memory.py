"""Keep the memory that a process frees, for the next image."""

from __future__ import annotations

from functools import cache

import numpy as np

MOST_KEPT = 31 * 2**20
"""Bytes; just below the largest block that can raise glibc's thresholds when it is freed."""


@cache
def keep_freed_memory() -> None:
    """Make this process, and those that it forks, keep up to 60 MB of the memory that they free.

    Each image is a megabyte. By default glibc returns this memory to the system and gets it back
    page by page, which can take as long as decoding. Freeing a large block raises the thresholds
    above which glibc does so: ``M_MMAP_THRESHOLD`` of mallopt(3). Other allocators ignore it.
    """
    np.empty(MOST_KEPT, np.uint8)
