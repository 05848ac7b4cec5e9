"""The names of versions at the command line: ``STORE``, ``STORE@ID``, or a snapshot's file."""

from __future__ import annotations

from pathlib import Path

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import place_of
from grasp_factory.dataset.snapshots.snapshot import is_sha256
from grasp_factory.dataset.snapshots.snapshot_folder import SnapshotFolder
from grasp_factory.dataset.snapshots.version import PresentVersion, StoredVersion, Version
from grasp_factory.errors import StoreMismatchError


def open_version(text: str) -> Version:
    """Return the version that a text names.

    Args:
        text: path of a store, as it is now; ``STORE@ID`` for one of its snapshots, of which the
            store itself need not be there; or path of a snapshot's file.

    Raises:
        UsageError: if there is no such store or snapshot.
        StoreError: if it is damaged.
    """
    path = store_path(text)
    if path.is_dir():
        return PresentVersion(path)
    if path.is_file():
        return _of_file(path)
    store, at, prefix = text.rpartition("@")
    if not at:
        raise StoreMismatchError(f"there is no store and no snapshot at {text}")
    return stored_version(SnapshotFolder.of(store_path(store)), prefix)


def stored_version(folder: SnapshotFolder, prefix: str) -> StoredVersion:
    """Return the version of a folder's snapshot whose id begins with ``prefix``.

    Raises:
        UsageError: if there is none, or several.
        StoreError: if it is damaged.
    """
    name = folder.resolve(prefix)
    return StoredVersion(folder, name, folder.read(name))


def _of_file(path: Path) -> StoredVersion:
    name = path.name.removesuffix(".json")
    if not is_sha256(name):
        valid = "a store, STORE@ID, or a snapshot's file ID.json"
        raise StoreMismatchError(f"{path} is a file, and no snapshot: valid: {valid}")
    folder = SnapshotFolder(place_of(path.parent))
    return StoredVersion(folder, name, folder.read(name))
