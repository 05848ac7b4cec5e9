"""The files and folders in a flywheel's folder; what cannot be read or made is one line."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.atomic_file import write_atomic
from grasp_factory.core.os_errors import MACHINE_TROUBLE
from grasp_factory.errors import StoreError, UsageError


def make_folder(path: Path) -> None:
    """Make a folder unless it is there.

    Raises:
        UsageError: if it cannot be one.
        StoreError: if the disk or its permissions do not let it be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _told(path, "cannot be a folder", error) from None


def read(file: Path) -> bytes | None:
    """Return what a file holds, or None if it is not there.

    Raises:
        UsageError: if it is no file.
        StoreError: if the disk or its permissions do not let it be read.
    """
    try:
        return file.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise _told(file, "cannot be read", error) from None


def write_if_new(file: Path, data: bytes) -> None:
    """Write a file at once, unless it holds these bytes already.

    Raises:
        UsageError, StoreError: as ``read`` does.
    """
    if read(file) == data:
        return
    try:
        write_atomic(file, data)
    except OSError as error:
        raise _told(file, "cannot be written", error) from None


def _told(path: Path, what: str, error: OSError) -> StoreError | UsageError:
    kind = StoreError if error.errno in MACHINE_TROUBLE else UsageError
    return kind(f"{path} {what}: {error.strerror}; mend that, or choose another folder")
