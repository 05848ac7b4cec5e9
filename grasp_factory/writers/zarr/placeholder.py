"""Folders in a store that Zarr has no part in, described so that its readers pass them by."""

from __future__ import annotations

from pathlib import Path

import zarr

from grasp_factory.core.atomic_file import fsync
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.metadata_checksum import seal


def write_placeholder(store: Path, name: str, description: str) -> None:
    """Describe the folder ``name`` of a store as an array of nothing; what is in it stays.

    Zarr's readers list groups, and warn of files that are not theirs; they do not look into arrays.

    Raises:
        OSError: if the disk fails.
    """
    folder = store / name
    (folder / "zarr.json").unlink(missing_ok=True)  # of one killed before its seal
    zarr.create_array(
        AtomicStore(folder),  # of the whole store it would look at the root's metadata, too
        shape=(0,),
        chunks=(1,),
        dtype="uint8",
        attributes={"description": description},
    )
    seal(folder / "zarr.json")
    fsync([folder / "zarr.json", folder, store])
