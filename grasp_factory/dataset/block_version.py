"""A version of a row's files, for caches of what was computed from them."""

from __future__ import annotations

from grasp_factory.core import schema
from grasp_factory.core.cache import digest
from grasp_factory.core.place import Place
from grasp_factory.writers.zarr.layout import block_files


def block_version(store: Place, block: int) -> str:
    """Return 16 hex digits that change when a block of a store is written again.

    They come from the file system. The checksums in a store do not serve as the key of a cache: a
    hostile store can have those of another store.

    Raises:
        OSError: if the block is not committed.
    """
    found = block_files(store, schema.STATUS, block, range(0))[0].stat()
    facts = (found.st_dev, found.st_ino, found.st_ctime_ns, found.st_size)
    return digest(repr(facts).encode())[:16]
