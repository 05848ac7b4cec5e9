"""Files and folders in a flywheel's folder; errors are one line."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from grasp_factory.core.atomic_file import write_atomic
from grasp_factory.core.limits import EMBEDDED
from grasp_factory.core.os_errors import MACHINE_ERRNOS
from grasp_factory.core.place import place_at
from grasp_factory.errors import RefusedFileError, StoreError, UsageError


def make_folder(path: Path) -> None:
    """Make a folder unless it exists.

    Raises:
        UsageError: if the path cannot be a folder.
        StoreError: if the disk or its permissions prevent it.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _error(path, "cannot be a folder", error) from None


def read(file: Path) -> bytes | None:
    """Return the content of a file, or None if it does not exist.

    Raises:
        UsageError: if the path is not a file, or the file is too large.
        StoreError: if the disk or its permissions prevent it.
    """
    try:
        place = place_at(file.resolve())
        if place.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        return place.read_bytes(EMBEDDED)
    except FileNotFoundError:
        return None
    except RefusedFileError as error:
        raise UsageError(f"{error}; choose another folder") from None
    except OSError as error:
        raise _error(file, "cannot be read", error) from None


def write_if_new(file: Path, data: bytes) -> None:
    """Write a file atomically, unless it has this content already.

    Raises:
        UsageError, StoreError: as ``read`` does.
    """
    if read(file) == data:
        return
    try:
        write_atomic(file, data)
    except OSError as error:
        raise _error(file, "cannot be written", error) from None


def _error(path: Path, what: str, error: OSError) -> StoreError | UsageError:
    kind = StoreError if error.errno in MACHINE_ERRNOS else UsageError
    return kind(f"{path} {what}: {error.strerror}; fix the cause, or choose another folder")
