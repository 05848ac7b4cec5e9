"""A lock file: the kernel locks it, and its content names the holder."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
from pathlib import Path

from grasp_factory.core.locked_file import CannotLockError, has_name, open_locked, try_upgrade
from grasp_factory.errors import StoreError, StoreMismatchError
from grasp_factory.writers.zarr.files import cannot_write

_OURS = re.compile(rb"(\S+ \d+\n)?")
"""Content of a lock file: host and process id, or ``shards`` and their number, or nothing yet. A
power cut may leave zeros instead."""
_LONGEST = 300


class LockFile:
    """Created when it is taken, removed when its last holder releases it.

    Another file that has its name is neither changed nor removed.
    """

    def __init__(self, file: Path, store: Path) -> None:
        """Lock nothing yet; ``store`` is named in errors."""
        self.file = file
        self._store = store
        self._descriptor: int | None = None

    def take(self, *, shared: bool = False) -> list[str] | None:
        """Take the lock; return None, or the words in the file of another holder.

        Raises:
            StoreMismatchError: if the file cannot be created, or another file has its name.
            StoreError: if the disk or its permissions prevent that, or there are no locks.
        """
        if self._descriptor is not None:
            return None
        holder: list[str] = []

        def read_holder(descriptor: int) -> None:
            holder[:] = self._words(descriptor)

        try:
            self._descriptor = open_locked(self.file, shared=shared, check=read_holder)
        except BlockingIOError:
            return holder
        except CannotLockError as error:
            raise StoreError(
                f"{self.file}: {error.strerror}; on a file system without locks give each run a"
                " store of its own, and merge them"
            ) from None
        except OSError as error:
            if error.errno in (errno.ELOOP, errno.EISDIR, errno.ENXIO):
                raise self._in_the_way() from None
            raise cannot_write(self._store, error) from None
        return None

    def content(self) -> list[str]:
        """Return the words in the file, whose lock is held."""
        assert self._descriptor is not None
        return self._words(self._descriptor)

    def say(self, text: str) -> None:
        """Write the name of the holder."""
        assert self._descriptor is not None
        with contextlib.suppress(OSError):  # a full disk: the lock is held nevertheless
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"{text}\n".encode(), 0)

    def upgrade(self) -> bool:
        """Return whether a shared lock could be made exclusive; if not, it is lost."""
        assert self._descriptor is not None
        return try_upgrade(self._descriptor)

    def release(self) -> None:
        """Remove the file if nobody else holds it, then unlock it.

        In this order nobody can hold the lock of a removed file unnoticed.
        """
        if self._descriptor is None:
            return
        if self.upgrade() and has_name(self._descriptor, self.file):
            with contextlib.suppress(OSError):  # so that a file that stays names no holder
                os.ftruncate(self._descriptor, 0)
            with contextlib.suppress(OSError):  # permission lost: the file stays, unlocked
                self.file.unlink()
        os.close(self._descriptor)
        self._descriptor = None

    def _words(self, descriptor: int) -> list[str]:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1 or found.st_size > _LONGEST:
            raise self._in_the_way()
        content = os.pread(descriptor, _LONGEST, 0)
        if not content.strip(b"\0"):
            return []
        if not _OURS.fullmatch(content):
            raise self._in_the_way()
        return content.decode(errors="replace").split()

    def _in_the_way(self) -> StoreMismatchError:
        return StoreMismatchError(
            f"{self.file} is in the way: it is no lock of grasp-factory; move it or choose"
            " another --out"
        )
