"""The folder of a store's snapshots, beside the store: ``grasps.zarr.snapshots``.

    ID.json                         a snapshot; ID is the SHA-256 of the file
    segments/SHA256.rows, .crc32c   what its rows are

Every file is named by its content, is written once, and never changes. So the folder fits into Git,
and two clones of it merge without conflicts. It may come from a stranger: a file whose content does
not have the SHA-256 in its name is refused.
"""

from __future__ import annotations

import hashlib
import heapq
import re
from collections.abc import Iterable
from pathlib import Path

from grasp_factory.core.atomic_file import PARTIAL
from grasp_factory.core.limits import DOCUMENT, SNAPSHOT_BYTES, SNAPSHOT_FILE, SNAPSHOTS
from grasp_factory.core.place import Place, fsync_places, place_at
from grasp_factory.dataset.snapshots.snapshot import Snapshot, snapshot_of
from grasp_factory.errors import StoreError, UsageError, shown
from grasp_factory.writers.zarr.files import locate

SUFFIX = ".snapshots"
SEGMENTS = "segments"
SHORT = 12
"""Digits of an id in messages."""
_SHORTEST = 4
_PREFIX = re.compile(rf"[0-9a-f]{{{_SHORTEST},64}}")
_NAME = re.compile(r"([0-9a-f]{64})\.json")


class SnapshotFolder:
    """The snapshots of a store.

    Attributes:
        place: the folder, whether it exists or not.
    """

    def __init__(self, place: Place) -> None:
        self.place = place

    @classmethod
    def of(cls, store: Path) -> SnapshotFolder:
        """Return the folder of the store at ``store``; links to one store lead to one folder.

        Raises:
            StoreMismatchError: if the path cannot lead to a store.
            StoreError: if its directory cannot be opened.
        """
        whole = locate(store)
        try:
            return cls(place_at(whole.with_name(whole.name + SUFFIX)))
        except OSError as error:
            raise StoreError(f"{store} cannot be read: {error.strerror}") from None

    def ids(self) -> list[str]:
        """Return the ids of all snapshots, sorted.

        Raises:
            StoreError: if the folder cannot be read, or is a file.
            LimitError: if they are too many.
        """
        try:
            names = self.place.names() if self.place.exists() else []
        except OSError as error:
            raise StoreError(f"{self.place} cannot be read: {error.strerror}") from None
        found = sorted(match[1] for name in names if (match := _NAME.fullmatch(name)))
        SNAPSHOTS.check(len(found), self.place)
        return found

    def resolve(self, prefix: str) -> str:
        """Return the id that begins with ``prefix``.

        Raises:
            UsageError: if none does, or several do.
        """
        if not _PREFIX.fullmatch(prefix):
            valid = f"{_SHORTEST} or more of its first hexadecimal digits"
            raise UsageError(f"snapshot {shown(prefix)}: valid: {valid}")
        known = self.ids()
        found = [name for name in known if name.startswith(prefix)]
        if len(found) == 1:
            return found[0]
        if found:
            raise UsageError(f"snapshot {prefix}: several begin with it: {_listed(found)}")
        raise UsageError(f"{self.place} has no snapshot {prefix}: valid: {_listed(known)}")

    def read(self, name: str) -> Snapshot:
        """Return the snapshot with an id.

        Raises:
            StoreError: if it is missing, or its file is not the one with this id.
        """
        file = self.place / f"{name}.json"
        try:
            data = file.read_bytes(DOCUMENT)
        except OSError as error:
            raise StoreError(f"{file} cannot be read: {error.strerror}") from None
        if hashlib.sha256(data).hexdigest() != name:
            raise _changed(file)
        return snapshot_of(data, file)

    def history(self) -> list[tuple[str, Snapshot]]:
        """Return id and record of all snapshots, the newest first; none before its children.

        Raises:
            StoreError: if one is damaged.
            LimitError: if they are too many, or too large together.
        """
        names = self.ids()
        try:
            size = sum((self.place / f"{name}.json").stat().st_size for name in names)
        except OSError as error:
            raise StoreError(f"{self.place} cannot be read: {error.strerror}") from None
        SNAPSHOT_BYTES.check(size, self.place)
        every = {name: self.read(name) for name in names}
        children = dict.fromkeys(every, 0)
        for snapshot in every.values():
            if snapshot.parent in children:
                children[snapshot.parent] += 1
        ready = [_Newest(every[name].created, name) for name, n in children.items() if not n]
        heapq.heapify(ready)
        out = []
        while ready:
            name = heapq.heappop(ready).name
            out.append((name, every[name]))
            parent = every[name].parent
            if parent in children:
                children[parent] -= 1
                if not children[parent]:
                    heapq.heappush(ready, _Newest(every[parent].created, parent))
        return out

    def read_segment(self, name: str, kind: str, size: int) -> bytes:
        """Return a segment's file.

        Args:
            name: its SHA-256.
            kind: ``rows`` or ``crc32c``.
            size: the bytes that it must have.

        Raises:
            StoreError: if it is missing, or is not the file with this name.
        """
        file = self.place / SEGMENTS / f"{name}.{kind}"
        try:
            data = file.read_bytes(SNAPSHOT_FILE)
        except OSError as error:
            raise StoreError(f"{file} cannot be read: {error.strerror}") from None
        if len(data) != size or hashlib.sha256(data).hexdigest() != name:
            raise _changed(file)
        return data

    def add(self, snapshot: Snapshot, written: Iterable[Place]) -> str:
        """Write a snapshot, durably, and return its id.

        Args:
            snapshot: the record.
            written: the files of its segments that were just written.

        Raises:
            OSError: if the disk fails.
        """
        self.place.mkdir(exist_ok=True)
        fsync_places([*written, self.place.parent])
        (self.place / f"{snapshot.id}.json").write(snapshot.to_bytes(), durable=True)
        return snapshot.id


class SegmentWriter:
    """Writes the segments that a folder lacks. Only one process may do so at a time.

    Attributes:
        written: their files, not on the disk yet (``fsync``), and their folder.
        bytes: their sizes together.
    """

    def __init__(self, folder: SnapshotFolder) -> None:
        self._folder = folder.place / SEGMENTS
        self.written: list[Place] = []
        self.bytes = 0

    def write(self, name: str, kind: str, data: bytes) -> None:
        """Write a segment unless it is there.

        Args:
            name: the SHA-256 of its bytes.
            kind: ``rows`` or ``crc32c``.
            data: its bytes.

        Raises:
            OSError: if the disk fails.
        """
        file = self._folder / f"{name}.{kind}"
        if file.exists():
            return
        if not self.written:
            self._begin()
        file.write(data)
        self.written.append(file)
        self.bytes += len(data)

    def _begin(self) -> None:
        """Make the folders, and remove what killed writers left in them."""
        for folder in (self._folder.parent, self._folder):
            folder.mkdir(exist_ok=True)
            for left in folder.glob(f"*{PARTIAL}"):
                left.unlink()
        self.written.append(self._folder)


def latest(history: Iterable[tuple[str, Snapshot]]) -> str | None:
    """Return the id of the newest snapshot of a history; None if it is empty."""
    return next((name for name, _ in history), None)


class _Newest:
    """A snapshot in a heap: the newest is first; of equally new ones, the one with a lower id."""

    def __init__(self, created: str, name: str) -> None:
        self.created, self.name = created, name

    def __lt__(self, other: _Newest) -> bool:
        return (other.created, self.name) < (self.created, other.name)


def _changed(file: Place) -> StoreError:
    what = "its content is not the one that its name states"
    return StoreError(f"{file} is damaged: {what}; get it from where the snapshots are kept")


def _listed(names: list[str]) -> str:
    shorts = [name[:SHORT] for name in names[:8]]
    return ", ".join(shorts) + (", ..." if len(names) > 8 else "") if names else "none"
