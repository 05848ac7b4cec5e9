"""One coordinator per store, or one per part of it: locks that vanish with their process.

The locks are the kernel's (flock), so a killed holder cannot leave one behind; a file beside the
store only says who holds it. It lies beside because creation renames the store itself.
"""

from __future__ import annotations

import fcntl
import glob
import os
import socket
import time
import warnings
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self

from grasp_factory.errors import StaleLockWarning, StoreBusyError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.lock_file import LockFile

WAIT_S = 60.0
"""Seconds that a part of a store waits while another one creates the store."""
_POLL_S = 0.1


class _Lock(ABC):
    """Held while the ``with`` block runs."""

    def __init__(self, path: Path) -> None:
        """Take nothing yet; ``path`` is the store's.

        Raises:
            StoreMismatchError: if the path cannot lead to a store.
        """
        self._path = path
        whole = locate(path)  # one store, one lock, whatever links lead to it
        self._stem = whole.with_name(f".{whole.name}.grasp-factory")
        self.file = Path(f"{self._stem}.lock")
        self._store = whole
        self._inside: int | None = None

    @abstractmethod
    def __enter__(self) -> Self:
        """Take the lock.

        Raises:
            StoreBusyError: naming the host and the process that hold it.
            StoreMismatchError: if the lock file cannot be made, or something else has its name.
            StoreError: if the disk or its permissions do not let it be made.
        """

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """Let go."""

    def _lock_inside(self, kind: int) -> None:
        """Lock the store's directory, if it is there: it may have other names, as a mount point.

        Raises:
            StoreBusyError: if somebody came by such a name.
        """
        if self._inside is not None:
            return
        try:
            inside = os.open(self._store, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError:  # no store yet, or one that cannot be read: whoever reads it says so
            return
        try:
            fcntl.flock(inside, kind | fcntl.LOCK_NB)
        except OSError as error:
            os.close(inside)
            if isinstance(error, BlockingIOError):
                raise self._busy([]) from None
            return  # some file systems lock files only
        self._inside = inside

    def _unlock_inside(self) -> None:
        if self._inside is not None:
            os.close(self._inside)
            self._inside = None

    def _busy(self, holder: list[str]) -> StoreBusyError:
        match holder:
            case ["shards", count]:
                who = f"runs with --shard I/{count} ({', '.join(self._parts(count))})"
            case [host, pid]:
                who = f"process {pid} on {host}"
            case _:
                who = "another process"
        return StoreBusyError(
            f"{self._path} is being written by {who}; wait for it or choose another --out"
        )

    def _parts(self, count: str = "*") -> list[str]:
        """Return who holds parts of the store; what killed ones have left is removed."""
        found = []
        stem = glob.escape(self._stem.name)
        for file in sorted(self.file.parent.glob(f"{stem}.shard-*-of-{count}.lock")):
            part = LockFile(file, self._path)
            holder = part.take()
            if holder is not None:
                found.append(f"process {holder[1]} on {holder[0]}" if holder else "another process")
            part.release()
        return found


class StoreLock(_Lock):
    """The whole store, ``.<name>.grasp-factory.lock``."""

    is_alone = True

    def share(self) -> None:
        """Let nobody in: there are no other parts. The store is there now."""
        self._lock_inside(fcntl.LOCK_EX)

    def try_alone(self) -> bool:
        """Return that it is alone."""
        return True

    def __enter__(self) -> Self:
        """See ``_Lock``. It is taken or refused at once."""
        self._lock = LockFile(self.file, self._path)
        holder = self._lock.take()
        if holder is not None:
            raise self._busy(holder)
        try:
            _claim(self._lock)
            self._parts()
            self._lock_inside(fcntl.LOCK_EX)
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """Let go."""
        self._unlock_inside()
        self._lock.release()


class ShardLock(_Lock):
    """One of K parts of a store: alone in that part, and together with the K - 1 others.

    Attributes:
        is_alone: no other part is being written, so the store may be created, grown or packed.
    """

    def __init__(self, path: Path, index: int, count: int) -> None:
        """Take nothing yet.

        Args:
            path: the store's.
            index: the part, from 0 on.
            count: K.
        """
        super().__init__(path)
        self._count = count
        self._part_file = Path(f"{self._stem}.shard-{index}-of-{count}.lock")
        self.is_alone = False

    def __enter__(self) -> Self:
        """See ``_Lock``. While another part creates the store, wait for it."""
        self._part, self._whole = (
            LockFile(file, self._path) for file in (self._part_file, self.file)
        )
        holder = self._part.take()
        if holder is not None:
            raise self._busy(holder)
        try:
            _claim(self._part)
            self._join(wait_s=WAIT_S)
            self._lock_inside(fcntl.LOCK_SH)
        except BaseException:
            self._whole.release()
            self._part.release()
            raise
        return self

    def share(self) -> None:
        """Let the other parts in, after the store was prepared."""
        self._whole.release()
        self._join(wait_s=WAIT_S, alone=False)
        self._lock_inside(fcntl.LOCK_SH)

    def try_alone(self) -> bool:
        """Return whether this is the last part at work. If not, it is one no more."""
        self.is_alone = self._whole.upgrade()
        if self.is_alone:
            self._parts()
        return self.is_alone

    def __exit__(self, *_: object) -> None:
        """Let go."""
        self._unlock_inside()
        self._whole.release()
        self._part.release()

    def _join(self, wait_s: float, *, alone: bool = True) -> None:
        """Take the whole alone where nobody has it, else together with the other parts."""
        mine = ["shards", str(self._count)]
        deadline = time.monotonic() + wait_s
        while True:
            holder = self._whole.take() if alone else mine
            if holder is None:
                _claim(self._whole, " ".join(mine))
                self.is_alone = True
                return
            holder = self._whole.take(shared=True)
            self.is_alone = False
            if holder is None:
                if not self._whole.content():  # the last of the others left just now
                    self._whole.say(" ".join(mine))
                holder = self._whole.content()
                if holder == mine:
                    return
                self._whole.release()
                raise self._busy(holder)
            if holder not in ([], mine) or time.monotonic() > deadline:
                raise self._busy(holder)
            time.sleep(_POLL_S)


def _claim(lock: LockFile, text: str = "") -> None:
    """Write down who holds a lock; warn of one who did not let go of it."""
    before = lock.content()
    if before:
        who = " ".join(before) if before[0] == "shards" else f"process {before[1]} on {before[0]}"
        warnings.warn(
            f"a run that ended without letting go ({who}) had {lock.file}; it is taken over",
            StaleLockWarning,
            stacklevel=3,
        )
    lock.say(text or f"{socket.gethostname()} {os.getpid()}")
