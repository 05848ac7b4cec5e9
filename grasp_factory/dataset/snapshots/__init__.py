"""Snapshots of a store: small files beside it that name the content of every row.

A snapshot trusts the columns ``checksum`` and ``array_crc32c``; ``verify`` ties them to the files.
"""

from grasp_factory.dataset.snapshots.naming import open_version
from grasp_factory.dataset.snapshots.snapshot import Snapshot, StoreContents
from grasp_factory.dataset.snapshots.snapshot_folder import SnapshotFolder
from grasp_factory.dataset.snapshots.version import PresentVersion, StoredVersion, Version

__all__ = [
    "PresentVersion",
    "Snapshot",
    "SnapshotFolder",
    "StoreContents",
    "StoredVersion",
    "Version",
    "open_version",
]
