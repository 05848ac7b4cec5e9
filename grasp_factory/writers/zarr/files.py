"""Files on a disk: where a path leads, surviving a power cut, saying why one cannot be made."""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from grasp_factory.core.os_errors import MACHINE_TROUBLE
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.atomic_store import aside

_WAITING = 16
"""Files that are waited for at once; on a local disk a block's 140 take a fifth of the time."""


def locate(path: Path) -> Path:
    """Return the absolute path of a store, links followed, whether there is anything or not.

    Raises:
        StoreMismatchError: if the path cannot lead anywhere: a circle of links, a name that is too
            long, a directory that may not be entered, the root.
    """
    try:
        target = path.resolve()
        os.stat(target)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, RuntimeError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise StoreMismatchError(f"{path} cannot be used: {why}; choose another path") from None
    if not target.name:
        raise StoreMismatchError(f"{path} is the root directory, no store; choose another path")
    return target


def fsync(paths: Iterable[Path]) -> None:
    """Wait until these files or directories are on the disk.

    A directory's fsync makes the names in it durable: files created, renamed or removed there.
    They are waited for all at once, so that the file system can take them together.
    """
    waited_for = list(paths)
    with ThreadPoolExecutor(_WAITING) as pool:
        try:
            done = pool.map(_fsync, waited_for)
        except RuntimeError:  # no more threads are allowed here: one after the other then
            done = map(_fsync, waited_for)
        for _ in done:
            pass  # what one of them raised is raised here


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_aside(file: Path, data: bytes) -> None:
    """Write a file aside and rename it: whoever reads it finds all of it or none."""
    aside(file).write_bytes(data)
    aside(file).replace(file)


def fsync_tree(root: Path) -> None:
    """Wait until everything below ``root``, and ``root`` itself, is on the disk."""
    fsync([*root.rglob("*"), root])


def cannot_write(path: Path, error: OSError) -> StoreError | StoreMismatchError:
    """Return the error to raise when a store, or its lock, cannot be made at ``path``."""
    if error.errno in MACHINE_TROUBLE:
        return StoreError(f"{path} cannot be written: {error.strerror}")
    parent = path.resolve().parent
    why = error.strerror if parent.is_dir() else f"there is no directory {parent}"
    return StoreMismatchError(f"{path} cannot be written: {why}; choose another --out")
