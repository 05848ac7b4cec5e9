"""One coordinator per store: a lock that vanishes with its process."""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path
from types import TracebackType
from typing import Self

from grasp_factory.errors import StoreBusyError
from grasp_factory.writers.files import cannot_write


class StoreLock:
    """Holds ``<path>.lock`` beside the store while the ``with`` block runs.

    The lock is the kernel's (flock), so a killed holder cannot leave it behind; the file only
    says who holds it. It lies beside the store because creation renames the store itself.
    """

    def __init__(self, path: Path) -> None:
        """Take nothing yet; ``path`` is the store's."""
        self._path = path
        whole = path.resolve()  # one store, one lock, whatever links lead to it
        self.file = whole.with_name(f"{whole.name}.lock")
        self._descriptor: int | None = None

    def __enter__(self) -> Self:
        """Take the lock, or fail at once.

        Raises:
            StoreBusyError: naming the host and the process that hold it.
            StoreMismatchError: if the lock file cannot be made.
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
            self.file.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None

    def _take(self) -> int | None:
        """Return the descriptor that holds the lock, or None when its file was just removed."""
        try:
            descriptor = os.open(self.file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise cannot_write(self._path, error) from None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_ino == os.stat(self.file).st_ino:
                return descriptor
        except FileNotFoundError:
            pass
        except BlockingIOError:
            holder = os.pread(descriptor, 300, 0).decode(errors="replace").split()
            os.close(descriptor)
            raise StoreBusyError(self._busy(holder)) from None
        os.close(descriptor)
        return None

    def _busy(self, holder: list[str]) -> str:
        who = f"process {holder[1]} on {holder[0]}" if len(holder) == 2 else "another process"
        return f"{self._path} is being written by {who}; wait for it or choose another --out"
