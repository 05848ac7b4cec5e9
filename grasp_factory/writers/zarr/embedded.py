"""What a store carries beside its rows, so that it never loses it: opaque bytes here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.writers.zarr.header import open_array, open_store, read_array
from grasp_factory.writers.zarr.layout import KEYS, ZSTD_LEVEL
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, values_digest

OBJECTS, MODELS = "objects", "models"
"""Groups: of users' objects by the name of their set, of trained models by their policy's."""
DESCRIPTIONS = {
    OBJECTS: "zip file of a manifest and the converted meshes of this set",
    MODELS: "safetensors file of the trained model that this policy ranks its grasps by",
}
CHUNK = 1 << 24
"""Bytes."""


def carried_by(config: FactoryConfig) -> dict[str, str]:
    """Return the SHA-256 that names what a store of this config carries, by path in the store."""
    objects = {f"{OBJECTS}/{name}": sha256 for name, sha256 in config.object_folders.items()}
    return objects | {f"{MODELS}/{name}": sha256 for name, sha256 in config.models.items()}


def add_carried(root: zarr.Group, path: str, content: bytes) -> None:
    """Put something to carry into a new store, at one of the paths of ``carried_by``."""
    data = np.frombuffer(content, np.uint8)
    array = root.create_array(
        path,
        shape=data.shape,
        chunks=(min(CHUNK, len(data)),),
        dtype="uint8",
        compressors=[ZstdCodec(level=ZSTD_LEVEL)],
        chunk_key_encoding=KEYS,  # type: ignore[arg-type]
        attributes={
            "units": "",
            "description": DESCRIPTIONS[path.partition("/")[0]],
            VALUES_SEAL: values_digest(data),
        },
    )
    array[:] = data


def read_carried(store: Path, path: str) -> bytes | None:
    """Return what a store carries at a path, None where it has nothing, or is none yet.

    Raises:
        StoreError: if the store is damaged.
    """
    if not (store / path / "zarr.json").exists():
        return None
    root, _ = open_store(store, mode="r")
    return read_array(open_array(root, path)).astype(np.uint8).tobytes()
