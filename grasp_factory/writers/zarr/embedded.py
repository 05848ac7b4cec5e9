"""Data embedded in a store in addition to its rows; here it is opaque bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import ZstdCodec

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.plugin_origin import listed
from grasp_factory.core.limits import EMBEDDED, SOURCE
from grasp_factory.core.place import place_of
from grasp_factory.writers.zarr.header import open_array, open_store, read_array
from grasp_factory.writers.zarr.layout import KEYS, ZSTD_LEVEL
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, values_digest

OBJECTS, MODELS, PLUGINS = "objects", "models", "plugins"
"""Groups: users' objects by the name of their set, trained models by that of their policy, source
files by their SHA-256."""
DESCRIPTIONS = {
    OBJECTS: "zip file of a manifest and the converted meshes of this set",
    MODELS: "safetensors file of the trained model that this policy ranks its grasps by",
    PLUGINS: "Python file of the user, which readers never run",
}
CHUNK = 1 << 24
"""Bytes of a chunk."""


def embedded_in(config: FactoryConfig) -> dict[str, str]:
    """Return the SHA-256 that names each embedded item of a store of this config, by path in it."""
    objects = {f"{OBJECTS}/{name}": sha256 for name, sha256 in config.object_folders.items()}
    models = {f"{MODELS}/{name}": sha256 for name, sha256 in config.models.items()}
    files = [origin.sha256 for _, _, origin in listed(config.plugins) if origin.file]
    return objects | models | {f"{PLUGINS}/{sha256}": sha256 for sha256 in files}


def add_embedded(root: zarr.Group, path: str, content: bytes) -> None:
    """Embed data in a new store, at one of the paths of ``embedded_in``."""
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


def read_embedded(store: Path, path: str) -> bytes | None:
    """Return the data embedded in a store at a path; None if there is no data, or no store yet.

    Raises:
        StoreError: if the store is damaged.
        LimitError: if they are too many.
    """
    try:
        if not (place_of(store) / path / "zarr.json").exists():
            return None
    except FileNotFoundError:
        return None
    root, _ = open_store(store, mode="r")
    values = read_array(open_embedded(root, path))
    return values.astype(np.uint8, copy=False).tobytes()


def open_embedded(root: zarr.Group, path: str) -> zarr.Array[Any]:
    """Return the array of data embedded at a path.

    Raises:
        StoreError: if the store is damaged.
        LimitError: if it is too large.
    """
    array = open_array(root, path)
    limit = SOURCE if path.startswith(f"{PLUGINS}/") else EMBEDDED
    limit.check(array.nbytes, f"{root.store}/{path}")
    return array
