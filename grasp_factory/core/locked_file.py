"""Opening a file and locking it: the lock is the kernel's (flock), so it ends with its process."""

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
    """Open a file for reading and writing, created if missing, and lock it.

    If another process replaced or removed the file between opening and locking, it is opened again:
    the file that is locked is the one that has the name.

    Args:
        file: the file; a link is refused.
        flags: of ``os.open``, in addition.
        mode: permissions of a file that is created.
        shared: let others share the lock.
        wait: wait for others who hold it.
        check: called with the descriptor before it is locked; what it raises is raised here.

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
    """Return whether a shared lock could be made exclusive; if not, it is lost."""
    try:
        _lock(descriptor, fcntl.LOCK_EX, wait=False)
    except BlockingIOError:
        return False
    return True


def has_name(descriptor: int, file: Path) -> bool:
    """Return whether an open file is still the one of that name."""
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
