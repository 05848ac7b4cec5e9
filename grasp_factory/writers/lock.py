"""One coordinator per store: a lock that vanishes with its process."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import socket
import stat
from pathlib import Path
from types import TracebackType
from typing import Self

from grasp_factory.errors import StoreBusyError, StoreMismatchError
from grasp_factory.writers.files import cannot_write, locate

_OURS = re.compile(rb"(\S+ \d+\n)?")
"""What a lock file holds: host and process, or nothing yet."""
_LONGEST = 300


class StoreLock:
    """Holds ``.<name>.grasp-factory.lock`` beside the store while the ``with`` block runs.

    The lock is the kernel's (flock), so a killed holder cannot leave it behind; the file only
    says who holds it. It lies beside the store because creation renames the store itself. A file
    of that name that is not ours is neither changed nor removed.
    """

    def __init__(self, path: Path) -> None:
        """Take nothing yet; ``path`` is the store's.

        Raises:
            StoreMismatchError: if the path cannot lead to a store.
        """
        self._path = path
        whole = locate(path)  # one store, one lock, whatever links lead to it
        self.file = whole.with_name(f".{whole.name}.grasp-factory.lock")
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        """Take the lock, or fail at once.

        Raises:
            StoreBusyError: naming the host and the process that hold it.
            StoreMismatchError: if the lock file cannot be made, or something else has its name.
        """
        while self._descriptor is None:
            self._descriptor = self._take()
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"{socket.gethostname()} {os.getpid()}\n".encode(), 0)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Remove the file, then let go: in this order nobody can hold a removed file unknown."""
        if self._descriptor is not None:
            if self._is_at_its_place(self._descriptor):
                self.file.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None

    def _take(self) -> int | None:
        """Return the descriptor that holds the lock, or None when its file was just removed."""
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            descriptor = os.open(self.file, flags, 0o644)
        except OSError as error:
            if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
                raise self._in_the_way() from None
            raise cannot_write(self._path, error) from None
        taken = False
        try:
            holder = self._holder(descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            taken = self._is_at_its_place(descriptor)
        except BlockingIOError:
            raise StoreBusyError(self._busy(holder)) from None
        finally:
            if not taken:
                os.close(descriptor)
        return descriptor if taken else None

    def _holder(self, descriptor: int) -> list[str]:
        """Return host and process from a lock file; nothing when nobody is named yet."""
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise self._in_the_way()
        content = os.pread(descriptor, _LONGEST + 1, 0)
        if len(content) > _LONGEST or not _OURS.fullmatch(content):
            raise self._in_the_way()
        return content.decode(errors="replace").split()

    def _is_at_its_place(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), os.lstat(self.file))
        except FileNotFoundError:
            return False

    def _in_the_way(self) -> StoreMismatchError:
        return StoreMismatchError(
            f"{self.file} is in the way: it is no lock of grasp-factory; move it or choose"
            " another --out"
        )

    def _busy(self, holder: list[str]) -> str:
        who = f"process {holder[1]} on {holder[0]}" if len(holder) == 2 else "another process"
        return f"{self._path} is being written by {who}; wait for it or choose another --out"
