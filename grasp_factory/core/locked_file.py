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
) -> int:
    """Open a file for reading and writing, create it if it is missing, and lock it.

    If another process replaces or removes the file between opening and locking, it is opened again,
    so that the locked file is the one with this name.

    Args:
        file: the file; a symbolic link is an error.
        flags: additional flags of ``os.open``.
        mode: permissions of the file if it is created.
        shared: take a shared lock instead of an exclusive one.
        wait: wait until other processes release the lock.
        check: called with the descriptor before it is locked; its exceptions are passed on.

    Returns:
        The descriptor; closing it releases the lock.

    Raises:
        BlockingIOError: if another process holds the lock, unless ``wait``.
        CannotLockError: if the file system has no locks.
        OSError: if the file cannot be opened.
    """
    flags |= os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    while True:
        descriptor = os.open(file, flags, mode)
        try:
            check(descriptor)
            _lock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX), wait=wait)
            if has_name(descriptor, file):
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


def has_name(descriptor: int, file: Path) -> bool:
    """Return whether the file at a path is still the one that the descriptor has open."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(file))
    except FileNotFoundError:
        return False


def _lock(descriptor: int, kind: int, *, wait: bool) -> None:
    try:
        fcntl.flock(descriptor, kind if wait else kind | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError as error:
        raise CannotLockError(error.errno, f"it cannot be locked: {error.strerror}") from None
