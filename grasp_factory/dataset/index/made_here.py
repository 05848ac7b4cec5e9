"""Which indexes this user built on this machine; no other is believed.

An index that somebody ships with a store could say anything of it, and of other stores. So each
index that is built here has a random token, which is also written to the cache, with the file's
device and inode. The cache is asked first: SQLite opens nothing that was not built here. It does
not keep unfinished changes in a file beside the index, where a stranger could put one: SQLite would
delete a file that such a journal names. So a change that was cut short is noticed by a fact in the
index (``is_whole``), and the index is built again.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

from grasp_factory.core.cache import cache_dir, read, write
from grasp_factory.core.locked_file import open_locked
from grasp_factory.errors import UsageError

SIDE_FILES = ("-journal", "-wal", "-shm")
"""Suffixes of the files beside a database that SQLite reads with it."""
UNUSED_S = 90 * 86_400.0
"""Seconds without use after which an index in the cache is removed."""


def new_token() -> str:
    """Return a token for a new index."""
    return secrets.token_hex(16)


def remember(index: Path, token: str) -> None:
    """Write down that the index was built here. If the cache cannot be written, it is not."""
    with contextlib.suppress(UsageError):
        write(_record(index), token.encode())


def token_of(index: Path) -> str | None:
    """Return the token of an index that was built here; None for any other file.

    The file must contain the same token: it may have got the inode of one that was deleted.
    """
    try:
        token = read(_record(index))
    except (OSError, UsageError):
        return None
    if not token or any(os.path.lexists(f"{index}{suffix}") for suffix in SIDE_FILES):
        return None
    return token.decode()


@contextlib.contextmanager
def changing(index: Path) -> Iterator[None]:
    """Wait for other processes that change an index, and let others wait.

    Raises:
        OSError: if the cache cannot be written.
        UsageError: if there is no place for the cache.
    """
    record = _record(index)
    record.parent.mkdir(parents=True, exist_ok=True)
    descriptor = open_locked(record.with_suffix(".lock"), wait=True)
    try:
        yield
    finally:
        os.close(descriptor)


def remove_side_files(index: Path) -> None:
    """Remove what SQLite would read together with a new index of this name."""
    for suffix in SIDE_FILES:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(f"{index}{suffix}")


def remove_unused(folder: Path) -> None:
    """Remove the indexes in a folder of the cache that were not used for a long time."""
    for index in folder.glob("*.sqlite"):
        with contextlib.suppress(OSError, UsageError):
            if time.time() - index.stat().st_mtime > UNUSED_S:
                for file in (_record(index), _record(index).with_suffix(".lock")):
                    file.unlink(missing_ok=True)
                remove_side_files(index)
                index.unlink()


def _record(index: Path) -> Path:
    found = index.stat()
    return cache_dir() / "indexes" / "made_here" / f"{found.st_dev}-{found.st_ino}"
