"""Archives of users' objects in a store: opaque bytes here, whatever they hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from grasp_factory.writers.header import open_array, open_store, read_array
from grasp_factory.writers.layout import KEYS, ZSTD_LEVEL
from grasp_factory.writers.seals import VALUES_SEAL, values_digest

GROUP = "objects"
CHUNK = 1 << 24
"""Bytes."""


def add_objects(root: zarr.Group, name: str, archive: bytes) -> None:
    """Put the archive of a set of objects into a new store."""
    data = np.frombuffer(archive, np.uint8)
    array = root.create_array(
        f"{GROUP}/{name}",
        shape=data.shape,
        chunks=(min(CHUNK, len(data)),),
        dtype="uint8",
        compressors=[ZstdCodec(level=ZSTD_LEVEL)],
        chunk_key_encoding=KEYS,  # type: ignore[arg-type]
        attributes={
            "units": "",
            "description": "zip file of a manifest and the converted meshes of this set",
            VALUES_SEAL: values_digest(data),
        },
    )
    array[:] = data


def read_objects(path: Path, name: str) -> bytes | None:
    """Return the archive of a set of objects, None where the store has none, or is none yet.

    Raises:
        StoreError: if the store is damaged.
    """
    if not (path / GROUP / name / "zarr.json").exists():
        return None
    root, _ = open_store(path, mode="r")
    return read_array(open_array(root, f"{GROUP}/{name}")).astype(np.uint8).tobytes()
