"""Files on a disk: making them survive a power cut, and saying why one cannot be made."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from grasp_factory.errors import StoreMismatchError


def fsync(paths: Iterable[Path]) -> None:
    """Wait until these files or directories are on the disk.

    A directory's fsync makes the names in it durable: files created, renamed or removed there.
    """
    for path in paths:
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def fsync_tree(root: Path) -> None:
    """Wait until everything below ``root``, and ``root`` itself, is on the disk."""
    fsync([*root.rglob("*"), root])


def cannot_write(path: Path, error: OSError) -> StoreMismatchError:
    """Return the error to raise when a store, or its lock, cannot be made at ``path``."""
    parent = path.resolve().parent
    why = error.strerror if parent.is_dir() else f"there is no directory {parent}"
    return StoreMismatchError(f"{path} cannot be written: {why}; choose another --out")
