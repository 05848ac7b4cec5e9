"""Locks of a store: one coordinator for the whole store, or one for each shard of a run.

They are the kernel's (flock), so they end with their process. The locked file names the holder. It
is next to the store, because creation renames the store itself.
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

from grasp_factory.core.object_storage.address import on_disk
from grasp_factory.errors import StaleLockWarning, StoreBusyError
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.lock_file import LockFile

WAIT_S = 60.0
"""Seconds that a shard waits while another one creates the store."""
_POLL_S = 0.1


class _Lock(ABC):
    """Held while the ``with`` block runs."""

    def __init__(self, path: Path) -> None:
        """Lock nothing yet.

        Args:
            path: the store.

        Raises:
            StoreMismatchError: if the path cannot lead to a store.
        """
        self._path = on_disk(path)
        whole = locate(path)  # links to one store lead to one lock
        self._stem = whole.with_name(f".{whole.name}.grasp-factory")
        self.file = Path(f"{self._stem}.lock")
        self._store = whole
        self._inside: int | None = None

    @abstractmethod
    def __enter__(self) -> Self:
        """Take the lock.

        Raises:
            StoreBusyError: naming the host and the process that hold it.
            StoreMismatchError: if the lock file cannot be created, or another file has its name.
            StoreError: if the disk or its permissions prevent that.
        """

    @abstractmethod
    def __exit__(self, *_: object) -> None:
        """Release the lock."""

    def _lock_inside(self, kind: int) -> None:
        """Lock the store's directory too, if it exists: it may be mounted under another path.

        Raises:
            StoreBusyError: if another process holds it under such a path.
        """
        if self._inside is not None:
            return
        flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            inside = os.open(self._store, flags)
        except OSError:  # no store yet, or one that cannot be read: its reader reports that
            return
        try:
            fcntl.flock(inside, kind | fcntl.LOCK_NB)
        except OSError as error:
            os.close(inside)
            if isinstance(error, BlockingIOError):
                raise self._busy([]) from None
            return  # some file systems lock only files
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
        """Return who holds shards of the store; remove the lock files of killed processes."""
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
    """Locks the whole store by ``.NAME.grasp-factory.lock``."""

    is_alone = True

    def share(self) -> None:
        """Also lock the store's directory exclusively, now that it exists."""
        self._lock_inside(fcntl.LOCK_EX)

    def try_alone(self) -> bool:
        """Return True: there are no other shards."""
        return True

    def __enter__(self) -> Self:
        """Take the lock without waiting; see ``_Lock``."""
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
        """Release the lock."""
        self._unlock_inside()
        self._lock.release()


class ShardLock(_Lock):
    """Locks one of K shards exclusively, and the whole store together with the K - 1 others.

    Attributes:
        is_alone: no other shard is being written, so the store may be created, grown or packed.
    """

    def __init__(self, path: Path, index: int, count: int) -> None:
        """Lock nothing yet.

        Args:
            path: the store.
            index: the shard, 0 to K - 1.
            count: K.
        """
        super().__init__(path)
        self._count = count
        self._part_file = Path(f"{self._stem}.shard-{index}-of-{count}.lock")
        self.is_alone = False

    def __enter__(self) -> Self:
        """Take the lock; wait while another shard creates the store. See ``_Lock``."""
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
        """Let the other shards join, after the store was prepared."""
        self._whole.release()
        self._join(wait_s=WAIT_S, alone=False)
        self._lock_inside(fcntl.LOCK_SH)

    def try_alone(self) -> bool:
        """Return whether this is the last shard at work; if not, it no longer locks the store."""
        self.is_alone = self._whole.upgrade()
        if self.is_alone:
            self._parts()
        return self.is_alone

    def __exit__(self, *_: object) -> None:
        """Release the lock."""
        self._unlock_inside()
        self._whole.release()
        self._part.release()

    def _join(self, wait_s: float, *, alone: bool = True) -> None:
        """Lock the store exclusively if nobody holds it, else together with the other shards."""
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
    """Write who holds a lock; warn if the last holder did not release it."""
    before = lock.content()
    if before:
        who = " ".join(before) if before[0] == "shards" else f"process {before[1]} on {before[0]}"
        warnings.warn(
            f"a run that ended did not release {lock.file} ({who}); it is taken over",
            StaleLockWarning,
            stacklevel=3,
        )
    lock.say(text or f"{socket.gethostname()} {os.getpid()}")
