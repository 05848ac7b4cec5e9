"""Descriptors of directories that were used lately, so that a file is opened in one call."""

from __future__ import annotations

import os
import threading
import weakref
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from grasp_factory.core.limits import Limit

T = TypeVar("T")

DIRECTORY = os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
"""Flags to open a directory with, for no more than to open what is in it; a link is refused."""
MOST_OPEN = 128
"""Most directories that are kept open; a store has about 90, a process may open 1024 files."""

Key = tuple[int, str]
"""The descriptor of a root, and the name of a directory below it."""


class Root:
    """A directory that stays open as long as this object is used.

    Attributes:
        path: the path that it was opened by, for messages.
        descriptor: opens what is in it.
    """

    def __init__(self, path: Path) -> None:
        """Open the directory at ``path``, whose own links are followed: its user named it.

        Raises:
            OSError: if there is no such directory.
        """
        self.path = path
        self.descriptor = os.open(path, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        weakref.finalize(self, _directories.give_up, self.descriptor)

    def use(self, folder: str, function: Callable[[int], T]) -> T:
        """Return what a function returns for the descriptor of a directory below it.

        Raises:
            OSError: if a part of the directory's name is missing or a link, and what the function
                raises. After a FileNotFoundError it is called again, with a new descriptor.
        """
        return _directories.use(self.descriptor, folder, function)

    def fetch_ahead(self, inner: Iterable[str], limit: Limit) -> None:
        """Get files below that are read soon; on a disk there is nothing to do.

        One that is missing or larger than the limit is left to its reader.
        """

    def at_once(self, reads: Sequence[Callable[[], T]]) -> list[T]:
        """Return what several reads return; they go at a time where each has to wait."""
        return [read() for read in reads]


class _Directories:
    """The descriptors of directories below roots.

    Several threads may use it. A directory that was removed, and made again by the same name, is
    found when a file is not in the one that was kept.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[Key, int] = OrderedDict()
        self._lock = threading.Lock()
        self._unused: deque[int] = deque()

    def use(self, root: int, folder: str, function: Callable[[int], T]) -> T:
        """See ``Root.use``."""
        key = (root, folder)
        with self._lock:  # a directory must not be closed between its choice and its use
            kept = self._open.get(key)
            if kept is not None:
                self._open.move_to_end(key)
                try:
                    return function(kept)
                except FileNotFoundError:
                    os.close(self._open.pop(key))
            self._close_unused()
            self._open[key] = walk(root, folder)
            if len(self._open) > MOST_OPEN:
                os.close(self._open.popitem(last=False)[1])
            return function(self._open[key])

    def give_up(self, root: int) -> None:
        """Leave it to the next call to close a root and the directories below it.

        The garbage collector may call this at any moment, also while the lock is held.
        """
        self._unused.append(root)

    def renew_lock(self) -> None:
        """Use a new lock in a forked process: a thread of the parent may hold the old one."""
        self._lock = threading.Lock()

    def _close_unused(self) -> None:
        while self._unused:
            root = self._unused.popleft()
            for key in [key for key in self._open if key[0] == root]:
                os.close(self._open.pop(key))
            os.close(root)


def walk(root: int, folder: str) -> int:
    """Return the descriptor of a directory below a root; no part of its name may be a link.

    Raises:
        OSError: as ``os.open``.
    """
    found = os.dup(root)
    for part in folder.split("/") if folder else ():
        try:
            below = os.open(part, DIRECTORY, dir_fd=found)
        finally:
            os.close(found)
        found = below
    return found


_directories = _Directories()
os.register_at_fork(after_in_child=_directories.renew_lock)
