"""A place in a store in object storage: like ``Place``, for reading."""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from grasp_factory.core.directories import Root
from grasp_factory.core.file_parts import FileParts
from grasp_factory.core.limits import OBJECT, Limit
from grasp_factory.core.object_storage.address import RemotePath
from grasp_factory.core.object_storage.objects import ObjectFacts, Objects
from grasp_factory.core.place import Place

T = TypeVar("T")
_FILE, _FOLDER = stat.S_IFREG | 0o444, stat.S_IFDIR | 0o555


class ObjectRoot(Root):
    """An address instead of a directory.

    Attributes:
        path: the address.
        objects: what is below it.
    """

    def __init__(self, path: RemotePath) -> None:
        """Connect to nothing yet; see ``Objects``."""
        self.path: Path = path
        self.address = path
        self.objects = Objects(path)

    def fetch_ahead(self, inner: Iterable[str], limit: Limit) -> None:
        """See ``Root.fetch_ahead``."""
        self.objects.fetch(list(inner), limit)

    def at_once(self, reads: Sequence[Callable[[], T]]) -> list[T]:
        """See ``Root.at_once``."""
        return self.objects.at_once(lambda read: read(), reads)


class ObjectParts(FileParts):
    """An object of which parts are read; its size is asked for when it is needed first."""

    def __init__(self, objects: Objects, key: str) -> None:
        self._objects, self._key = objects, key
        self._size: int | None = None

    @property
    def size(self) -> int:  # type: ignore[override]
        """Its bytes."""
        if self._size is None:
            self._size = self._objects.facts(self._key).size
        return self._size

    def read(self, length: int, start: int) -> bytes:
        """See ``FileParts.read``."""
        return self._objects.part(self._key, start, min(start + length, self.size))

    def several(self, parts: Sequence[tuple[int, int]]) -> Iterator[tuple[int, memoryview]]:
        """See ``FileParts.several``; parts close together are one request, others go at a time."""
        size = self.size
        ends = [(start, min(start + length, size)) for start, length in parts]
        return self._objects.parts(self._key, ends)

    def tail(self, length: int) -> bytes:
        """See ``FileParts.tail``."""
        data, self._size = self._objects.tail(self._key, length)
        return data

    def close(self) -> None:
        """Keep nothing open."""


class ObjectPlace(Place):
    """An object, or the prefix that objects share, below an address.

    A prefix is a directory, which exists while an object has it. There are no links. Whatever would
    change something raises the error of ``RemotePath.refuse``.
    """

    __slots__ = ()
    root: ObjectRoot

    @property
    def _objects(self) -> Objects:
        return self.root.objects

    def _key(self, name: str) -> str:
        return f"{self.inner}/{name}".strip("/")

    def open_file(self, name: str) -> tuple[int, int]:
        """Return the descriptor of a copy of an object without a name, and its bytes."""
        data = self._objects.get(self._key(name), OBJECT)
        with tempfile.TemporaryFile() as file:
            file.write(data)
            file.flush()
            return os.dup(file.fileno()), len(data)

    def open_parts(self, name: str) -> FileParts:
        """See ``Place.open_parts``; a missing object raises its error when it is read."""
        return ObjectParts(self._objects, self._key(name))

    def read_file(self, name: str, limit: Limit) -> bytes:
        """See ``Place.read_file``."""
        return self._objects.get(self._key(name), limit)

    def size_of(self, name: str) -> int:
        """See ``Place.size_of``."""
        return self._objects.facts(self._key(name)).size

    def stat(self) -> os.stat_result:
        """Return the facts of an object or a prefix.

        Device and inode are a hash of server, address, key and tag, for keys of caches. Those of a
        prefix come from the names and tags of all objects below it.
        """
        if self.inner:
            with contextlib.suppress(FileNotFoundError):
                return self._facts_of(self._objects.facts(self.inner))
        total = newest = count = 0
        for facts in self._objects.below(self.inner):
            total ^= self._objects.mark(facts)
            newest, count = max(newest, facts.modified_ns), count + 1
        if not count:
            raise FileNotFoundError(2, "no such object", str(self))
        return _result(_FOLDER, total, 0, newest)

    def _mode(self) -> int:
        """Return the kind of what is here; of a prefix, one object is enough. 0: nothing."""
        if self._objects.is_kept(self.inner):
            return _FILE
        if self.inner:
            with contextlib.suppress(FileNotFoundError):
                self._objects.facts(self.inner)
                return _FILE
        return _FOLDER if next(self._objects.below(self.inner), None) else 0

    def names(self) -> list[str]:
        """See ``Place.names``."""
        folders, files = self.entries()
        return folders + files

    def entries(self) -> tuple[list[str], list[str]]:
        """Return the names of the directories and of the files here, sorted."""
        folders, files = set[str](), list[str]()
        for facts in self._objects.below(self.inner):
            name, is_folder, _ = facts.key[len(self.inner) :].lstrip("/").partition("/")
            if is_folder:
                folders.add(name)
            else:
                files.append(name)
        return sorted(folders), sorted(files)

    def file_facts(self) -> Iterator[tuple[str, os.stat_result]]:
        """Yield name and facts of each object here, by one listing."""
        for place, facts in self.files_below():
            if place.parent.inner == self.inner:
                yield place.name, facts

    def files_below(self) -> Iterator[tuple[Place, os.stat_result]]:
        """Yield all objects below, at any depth, with their facts, by one listing."""
        for facts in self._objects.below(self.inner):
            yield ObjectPlace(self.root, facts.key), self._facts_of(facts)

    @contextlib.contextmanager
    def above(self) -> Iterator[tuple[int, str]]:
        """Refuse: every change goes through here."""
        self.root.address.refuse()
        yield  # type: ignore[unreachable]

    def _facts_of(self, facts: ObjectFacts) -> os.stat_result:
        return _result(_FILE, self._objects.mark(facts), facts.size, facts.modified_ns)


def _result(mode: int, mark: int, size: int, modified_ns: int) -> os.stat_result:
    seconds = modified_ns // 10**9
    device, inode = mark >> 63, mark & (2**63 - 1)
    values = (mode, inode, device, 1, 0, 0, size, seconds, seconds, seconds)
    times = {f"st_{kind}time_ns": modified_ns for kind in "amc"}
    return os.stat_result(values, times | {f"st_{kind}time": float(seconds) for kind in "amc"})


def object_place(path: RemotePath) -> ObjectPlace:
    """Return the place of a store at an address, whether it exists or not; see ``Objects``."""
    return ObjectPlace(ObjectRoot(path))
