"""How many bytes files take on the disk: few for a file with holes, whatever its size."""

from __future__ import annotations

import os
from pathlib import Path

_BLOCK_BYTES = 512
"""What ``st_blocks`` counts, on every file system."""


def bytes_on_disk(found: os.stat_result) -> int:
    """Return the bytes that a file takes, by its facts."""
    return found.st_blocks * _BLOCK_BYTES


def stored_bytes(path: Path) -> int:
    """Return the bytes that a file takes, or all files below a folder; links in it count nothing.

    What cannot be read counts nothing, too.
    """
    return _size(path) + sum(
        _size(Path(folder, name), follow=False)
        for folder, _, names in os.walk(path)
        for name in names
    )


def _size(path: Path, *, follow: bool = True) -> int:
    try:
        return bytes_on_disk(path.stat(follow_symlinks=follow))
    except OSError:
        return 0
