"""Describe a store's folders of files that are not Zarr's, so that Zarr's readers skip them."""

from __future__ import annotations

import zarr

from grasp_factory.core.place import Place, fsync_places
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.metadata_checksum import seal


def write_placeholder(store: Place, name: str, description: str) -> None:
    """Describe the folder ``name`` of a store as an array of length 0; the files in it stay.

    Zarr's readers list groups and warn of unknown files; they do not list the folders of arrays.

    Raises:
        OSError: if the disk fails.
    """
    folder = store / name
    folder.mkdir(exist_ok=True)
    # It may be left by a process that was killed before it sealed the file.
    (folder / "zarr.json").unlink(missing_ok=True)
    zarr.create_array(
        AtomicStore(folder),  # with the whole store Zarr would read the root's metadata too
        shape=(0,),
        chunks=(1,),
        dtype="uint8",
        attributes={"description": description},
    )
    seal(folder / "zarr.json")
    fsync_places([folder / "zarr.json", folder, store])
