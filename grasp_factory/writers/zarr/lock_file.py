"""A file that the kernel locks, and that says who holds it."""

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
"""What a lock file holds: host and process, or ``shards`` and their number, or nothing yet. A power
cut may leave zeros in its place."""
_LONGEST = 300


class LockFile:
    """Made when it is taken, removed when nobody has it any more.

    A file of that name that is not ours is neither changed nor removed.
    """

    def __init__(self, file: Path, store: Path) -> None:
        """Take nothing yet; ``store`` is named in errors."""
        self.file = file
        self._store = store
        self._descriptor: int | None = None

    def take(self, *, shared: bool = False) -> list[str] | None:
        """Take the lock; return None, or the words of the one who has it.

        Raises:
            StoreMismatchError: if the file cannot be made, or something else has its name.
            StoreError: if the disk or its permissions do not let it be made.
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
        """Return the words of the file of a lock that is held."""
        assert self._descriptor is not None
        return self._words(self._descriptor)

    def say(self, text: str) -> None:
        """Write who holds it."""
        assert self._descriptor is not None
        with contextlib.suppress(OSError):  # a full disk: the lock holds all the same
            os.ftruncate(self._descriptor, 0)
            os.pwrite(self._descriptor, f"{text}\n".encode(), 0)

    def upgrade(self) -> bool:
        """Return whether a shared lock could be made exclusive; if not, it is lost."""
        assert self._descriptor is not None
        return try_upgrade(self._descriptor)

    def release(self) -> None:
        """Remove the file if nobody else has it, then let go.

        In this order nobody can hold a removed file unknown.
        """
        if self._descriptor is None:
            return
        if self.upgrade() and has_name(self._descriptor, self.file):
            with contextlib.suppress(OSError):  # so that what stays tells of nobody
                os.ftruncate(self._descriptor, 0)
            with contextlib.suppress(OSError):  # permission lost: the file stays, the lock goes
                self.file.unlink()
        os.close(self._descriptor)
        self._descriptor = None

    def _words(self, descriptor: int) -> list[str]:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise self._in_the_way()
        content = os.pread(descriptor, _LONGEST + 1, 0)
        if not content.strip(b"\0"):
            return []
        if len(content) > _LONGEST or not _OURS.fullmatch(content):
            raise self._in_the_way()
        return content.decode(errors="replace").split()

    def _in_the_way(self) -> StoreMismatchError:
        return StoreMismatchError(
            f"{self.file} is in the way: it is no lock of grasp-factory; move it or choose"
            " another --out"
        )
