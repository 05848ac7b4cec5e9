"""Resolve the path of a store, and choose the error to raise when it cannot be written."""

from __future__ import annotations

import os
from pathlib import Path

from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.os_errors import MACHINE_ERRNOS
from grasp_factory.errors import StoreError, StoreMismatchError


def locate(path: Path) -> Path:
    """Return the absolute path of a store, links followed, whether it exists or not.

    Raises:
        StoreMismatchError: if the path cannot lead anywhere: a circle of links, a name that is too
            long, a directory that may not be entered, the root.
    """
    if is_remote(path):
        return path
    try:
        target = Path(os.path.realpath(path))  # raises nothing for a loop; stat does
        os.stat(target)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise StoreMismatchError(f"{path} cannot be used: {why}; choose another path") from None
    if not target.name:
        raise StoreMismatchError(f"{path} is the root directory, no store; choose another path")
    return target


def cannot_write(path: Path, error: OSError) -> StoreError | StoreMismatchError:
    """Return the error to raise when a store, or its lock, cannot be made at ``path``."""
    if error.errno in MACHINE_ERRNOS:
        return StoreError(f"{path} cannot be written: {error.strerror}")
    parent = path.resolve().parent
    why = error.strerror if parent.is_dir() else f"there is no directory {parent}"
    return StoreMismatchError(f"{path} cannot be written: {why}; choose another --out")
