"""A path in a store: like ``pathlib.Path``, but no link is followed and no pipe is opened.

A store may come from a stranger. A link in it could lead a reader to any file of its user, and make
a writer overwrite or delete it; opening a pipe or a device can block without end. A ``Place`` opens
nothing but directories and regular files, by descriptors, so what happens to a store happens inside
of it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import sys
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from grasp_factory.core.atomic_file import PARTIAL, fsync_descriptors
from grasp_factory.core.directories import Root, walk
from grasp_factory.core.file_parts import FileParts
from grasp_factory.core.limits import DEPTH, Limit
from grasp_factory.core.object_storage.address import RemotePath
from grasp_factory.core.regular_file import check_inside, check_parts, irregular, read_and_close

_READ = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC


class Place:
    """A file or directory below a root, whether it exists or not.

    The methods are like those of ``pathlib.Path`` with the same names. They raise
    ``IrregularFileError`` if a part of the path below the root is a link, or if something there is
    neither a directory nor a regular file.

    Attributes:
        root: the directory that was opened.
        inner: the path below it, with ``/``; empty for the root itself.
    """

    __slots__ = ("inner", "root")

    def __init__(self, root: Root, inner: str = "") -> None:
        self.root, self.inner = root, inner

    def __truediv__(self, inner: str) -> Place:
        check_inside(self.root.path, inner)
        return type(self)(self.root, f"{self.inner}/{inner}".strip("/"))

    def __str__(self) -> str:
        return str(self.path)

    @property
    def path(self) -> Path:
        """The path, for messages."""
        return self.root.path / self.inner

    @property
    def name(self) -> str:
        """The last part of the path."""
        return self.inner.rpartition("/")[2] or self.root.path.name

    @property
    def parent(self) -> Place:
        """The place that this one is in; the root is its own parent."""
        return type(self)(self.root, self.inner.rpartition("/")[0])

    @property
    def partial(self) -> Place:
        """The place of a file that is renamed to this one when it is complete."""
        return self.parent / (self.name + PARTIAL)

    def below(self, above: Place) -> str:
        """Return the path below another place, with ``/``."""
        return self.inner[len(above.inner) :].lstrip("/")

    def open(self) -> int:
        """Return the descriptor of a regular file, open for reading."""
        return self.parent.open_file(self.name)[0]

    def open_file(self, name: str) -> tuple[int, int]:
        """Return the descriptor of a file in a directory, open for reading, and its bytes."""
        try:
            descriptor = self.root.use(self.inner, lambda here: os.open(name, _READ, dir_fd=here))
        except OSError as error:
            (self / name)._explain(error)
            raise
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            os.close(descriptor)
            raise irregular(self.path / name)
        return descriptor, found.st_size

    def open_parts(self, name: str) -> FileParts:
        """Return a file in a directory, to read parts of it."""
        return FileParts(*self.open_file(name))

    def read_bytes(self, limit: Limit) -> bytes:
        """Return the content of a file.

        Raises:
            LimitError: if it has more bytes than the limit.
        """
        return self.parent.read_file(self.name, limit)

    def read_file(self, name: str, limit: Limit) -> bytes:
        """Return the content of a file in a directory, as ``read_bytes`` of its place."""
        descriptor, size = self.open_file(name)
        return read_and_close(descriptor, size, limit, self / name if size > limit.usual else self)

    def stat(self) -> os.stat_result:
        """Return the facts of a file or directory."""
        folder, _, leaf = self.inner.rpartition("/")
        look = partial(os.stat, leaf or ".", follow_symlinks=False)
        try:
            found = self.root.use(folder, lambda above: look(dir_fd=above))
        except OSError as error:
            self._explain(error)
            raise
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
            raise irregular(self.path)
        return found

    def size_of(self, name: str) -> int:
        """Return the bytes of a file in a directory, faster than ``stat`` of its place."""
        return self.root.use(
            self.inner, lambda here: os.stat(name, dir_fd=here, follow_symlinks=False)
        ).st_size

    def exists(self) -> bool:
        """Return whether there is a file or a directory."""
        return bool(self._mode())

    def is_dir(self) -> bool:
        """Return whether there is a directory."""
        return stat.S_ISDIR(self._mode())

    def is_file(self) -> bool:
        """Return whether there is a file."""
        return stat.S_ISREG(self._mode())

    def _mode(self) -> int:
        try:
            return self.stat().st_mode
        except OSError as error:
            if error.errno not in (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG):
                raise
            return 0

    def names(self) -> list[str]:
        """Return the names in a directory, in no order."""
        descriptor = self.open_directory()
        try:
            return os.listdir(descriptor)
        finally:
            os.close(descriptor)

    def glob(self, pattern: str) -> list[Place]:
        """Return what is in a directory and has such a name; nothing if there is no directory."""
        if not self.is_dir():
            return []
        return [self / name for name in sorted(self.names()) if fnmatchcase(name, pattern)]

    def write(self, data: bytes | bytearray | memoryview, *, durable: bool = False) -> None:
        """Write a file, or replace it: readers find all of the old content, or all of the new.

        It is written as ``partial`` first, where a file that a killed writer left is replaced.

        Args:
            data: its new content.
            durable: return when the file and its name are on the disk.
        """
        with self.above() as (above, leaf):
            partial = leaf + PARTIAL
            with contextlib.suppress(FileNotFoundError):
                os.unlink(partial, dir_fd=above)
            with os.fdopen(os.open(partial, _CREATE, 0o666, dir_fd=above), "wb") as file:
                file.write(data)
            if durable:  # first the content: a power cut must not leave the name with nothing in it
                fsync_places([self.partial])
            os.replace(partial, leaf, src_dir_fd=above, dst_dir_fd=above)
        if durable:
            fsync_places([self.parent])

    def create(self) -> int:
        """Return the descriptor of a new file, open for writing."""
        with self.above() as (above, leaf):
            return os.open(leaf, _CREATE, 0o666, dir_fd=above)

    def mkdir(self, *, parents: bool = False, exist_ok: bool = False) -> None:
        """Make a directory."""
        if parents and self.inner and not self.parent.exists():
            self.parent.mkdir(parents=True, exist_ok=True)
        try:
            with self.above() as (above, leaf):
                os.mkdir(leaf, dir_fd=above)
        except FileExistsError:
            if not (exist_ok and self.is_dir()):
                raise

    def rmdir(self) -> None:
        """Remove an empty directory."""
        self.stat()
        with self.above() as (above, leaf):
            os.rmdir(leaf, dir_fd=above)

    def unlink(self, *, missing_ok: bool = False) -> None:
        """Remove a file; of a link, the link itself."""
        try:
            with self.above() as (above, leaf):
                os.unlink(leaf, dir_fd=above)
        except FileNotFoundError:
            if not missing_ok:
                raise

    def rmtree(self) -> None:
        """Remove a directory and everything in it; links in it are removed, not followed.

        Raises:
            LimitError: if directories are nested too deep.
        """
        self.stat()
        with self.above() as (above, leaf):
            try:
                shutil.rmtree(leaf, dir_fd=above)
            except RecursionError:
                DEPTH.check(sys.getrecursionlimit(), self.path)

    def replace(self, target: Place) -> None:
        """Give a file or a directory another name; a file that has it already is replaced."""
        with self.above() as (source, before), target.above() as (there, after):
            os.replace(before, after, src_dir_fd=source, dst_dir_fd=there)

    def open_for_sync(self, flags: int = 0) -> int:
        """Return the descriptor of a file or a directory."""
        with self.above() as (above, leaf):
            return os.open(leaf, _READ | flags, dir_fd=above)

    def open_directory(self) -> int:
        """Return the descriptor of a directory, to list what is in it."""
        return self.open_for_sync(os.O_DIRECTORY)

    @contextlib.contextmanager
    def above(self) -> Iterator[tuple[int, str]]:
        """Yield the descriptor of the directory that this place is in, and the name in it.

        An error because a link has this name is explained.
        """
        folder, _, leaf = self.inner.rpartition("/")
        with contextlib.ExitStack() as stack:
            try:
                descriptor = walk(self.root.descriptor, folder)
                stack.callback(os.close, descriptor)
                yield descriptor, leaf or "."
            except OSError as error:
                self._explain(error)
                raise

    def _explain(self, error: OSError) -> None:
        """Raise an error that names the link, or the irregular file, that has caused this one.

        Any other error gets the whole path.
        """
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.ENOTDIR):
            check_parts(self.root.path, self.inner)
        error.filename = str(self.path)


def fsync_places(places: Iterable[Place]) -> None:
    """Wait until files or directories are on the disk; see ``atomic_file.fsync``.

    Raises:
        OSError: if the disk fails.
    """
    fsync_descriptors(place.open_for_sync for place in places)


def place_at(path: Path) -> Place:
    """Return the place of a path, whether anything is there or not, in its existing directory.

    Raises:
        OSError: if there is no such directory.
    """
    return place_of(path.parent) / path.name


def place_of(store: Path) -> Place:
    """Return the place of a store, an existing directory; links that lead to it are followed.

    Raises:
        OSError: if there is no such directory.
        StorageError: if it is in object storage that cannot be used.
    """
    return store.place() if isinstance(store, RemotePath) else Place(Root(store))
