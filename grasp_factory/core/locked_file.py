"""Opening and locking a file; the kernel releases the lock (flock) when its process ends."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from pathlib import Path


class CannotLockError(OSError):
    """The file system has no locks, or the kernel has none left."""


def open_locked(
    file: Path,
    *,
    flags: int = 0,
    mode: int = 0o644,
    shared: bool = False,
    wait: bool = False,
    check: Callable[[int], None] = lambda descriptor: None,
    folder: int | None = None,
) -> int:
    """Open a file for reading and writing, create it if it is missing, and lock it.

    If another process replaces or removes the file between opening and locking, it is opened again,
    so that the locked file is the one with this name.

    Args:
        file: the file; a link is refused.
        flags: of ``os.open``, in addition.
        mode: permissions of a file that is created.
        shared: let others share the lock.
        wait: wait for others who hold it.
        check: called with the descriptor before it is locked; what it raises is raised here.
        folder: descriptor of the directory that a relative path starts at.

    Returns:
        The descriptor; closing it releases the lock.

    Raises:
        BlockingIOError: if another process holds the lock, unless ``wait``.
        CannotLockError: if the file system has no locks.
        OSError: if the file cannot be opened.
    """
    flags |= os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        descriptor = os.open(file, flags, mode, dir_fd=folder)
        try:
            check(descriptor)
            _lock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX), wait=wait)
            if has_name(descriptor, file, folder):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def try_upgrade(descriptor: int) -> bool:
    """Try to make a shared lock exclusive; return False if this fails, and the lock is lost."""
    try:
        _lock(descriptor, fcntl.LOCK_EX, wait=False)
    except BlockingIOError:
        return False
    return True


def has_name(descriptor: int, file: Path, folder: int | None = None) -> bool:
    """Return whether an open file still has that name; ``folder`` as in ``open_locked``."""
    try:
        there = os.stat(file, dir_fd=folder, follow_symlinks=False)
        return os.path.samestat(os.fstat(descriptor), there)
    except FileNotFoundError:
        return False


def _lock(descriptor: int, kind: int, *, wait: bool) -> None:
    try:
        fcntl.flock(descriptor, kind if wait else kind | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        raise CannotLockError(error.errno, f"it cannot be locked: {error.strerror}") from None
