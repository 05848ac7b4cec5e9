"""The root attributes of a store: written once, checked each time it is opened."""

from __future__ import annotations

import copy
import platform
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from traceback import clear_frames
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.core.metadata import ArrayV3Metadata
from zarr.storage import MemoryStore, StorePath

from grasp_factory import __version__
from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.machine import platform_facts
from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.core.schema import FORMAT, FORMAT_VERSION, Field
from grasp_factory.errors import (
    NO_DAMAGE,
    RefusedFileError,
    StorageError,
    StoreError,
    StoreMismatchError,
)
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.bounded_codecs import bounded
from grasp_factory.writers.zarr.budgets import check_whole
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.metadata_checksum import is_intact
from grasp_factory.writers.zarr.pending_reads import ending_failed_reads

LICENSE = "MIT"
_NEEDED = {"config": dict, "config_sha256": str, "versions": dict, "platform": dict}
"""Attributes that every reader needs, with their JSON types."""
SOURCES = "sources"
"""The attribute of stores that were merged or split from others: the origin of their rows.

Their rows have recipes of any seed and index, which are in the columns of these names."""
CONVENTIONS = {
    "units": "SI: metres, kilograms, seconds, newtons, radians; each array has its own attribute",
    "quaternion": "xyzw, scalar last, unit",
    "frames": "T_a_b maps coordinates in frame b to frame a; TCP: +z approaches, +y closes",
    "camera": "OpenCV: +x right, +y down, +z forward; depth is along +z, not along the ray",
}


def root_attributes(config: FactoryConfig, extra: Mapping[str, Any]) -> dict[str, Any]:
    """Return the root attributes of a new store; they do not depend on time, host or path."""
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "seed": config.seed,
        "config": config.to_plain(),
        "config_sha256": config.sha256(),
        "block_size": config.block_size,
        "renderer": config.renderer.value,
        "versions": {
            "python": platform.python_version(),
            **{name: _version(name) for name in ("pybullet", "numpy", "zarr")},
            **({"torch": _version("torch")} if config.models else {}),
            "grasp_factory": __version__,
        },
        "platform": platform_facts(),
        "conventions": CONVENTIONS,
        "license": LICENSE,
        "created_by": f"grasp-factory {__version__}",
        **extra,
    }


def read_attributes(path: Path) -> dict[str, Any]:
    """Return the root attributes of the store at ``path``.

    Raises:
        StoreMismatchError: if there is nothing, something else, or a newer version.
        StoreError: if the store's metadata is damaged.
    """
    locate(path)
    if is_remote(path):  # it has no directories
        return _root_attributes(path)
    if not path.exists():
        raise StoreMismatchError(f"there is no store at {path}")
    if not path.is_dir():
        raise StoreMismatchError(f"{path} is a file, not a grasp-factory store")
    return _root_attributes(path)


def _root_attributes(path: Path) -> dict[str, Any]:
    try:
        metadata = parsed((place_of(path) / "zarr.json").read_bytes(DOCUMENT))
        attributes = metadata["attributes"]
        ours = attributes["format"] == FORMAT
        newer = attributes["format_version"] > FORMAT_VERSION if ours else False
    except FileNotFoundError:
        raise StoreMismatchError(f"{path} is not a grasp-factory store") from None
    except OSError as error:
        raise StoreError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise StoreError(f"{path} is damaged: zarr.json: {first_line(error)}") from None
    except (KeyError, TypeError):
        ours = False
    if not ours:
        raise StoreMismatchError(f"{path} is not a grasp-factory store")
    if newer:
        raise StoreMismatchError(
            f"{path} has format version {attributes['format_version']}, this version of"
            f" grasp-factory reads up to {FORMAT_VERSION}: install a newer one"
        )
    for key, kind in _NEEDED.items():
        if not isinstance(attributes.get(key), kind):
            raise StoreError(f"{path} is damaged: zarr.json: attribute {key} is missing or broken")
    return dict(attributes)


def open_store(path: Path, mode: Literal["r", "r+"]) -> tuple[zarr.Group, FactoryConfig]:
    """Open the store at ``path`` and read its config.

    Raises:
        StoreMismatchError: if there is nothing, something else, or a newer version.
        StoreError: if the store is damaged.
    """
    attributes = read_attributes(path)
    try:
        config = FactoryConfig.from_plain(attributes["config"])
        store = AtomicStore(place_of(path), read_only=mode == "r")
        return zarr.open_group(store, mode=mode, zarr_format=3), config
    except NO_DAMAGE:
        raise
    except Exception as error:  # Zarr raises any exception at damaged metadata
        raise StoreError(f"{path} is damaged: {first_line(error)}") from None


def fields_of(path: Path, config: FactoryConfig, attributes: Mapping[str, Any]) -> dict[str, Field]:
    """Return by path the fields of the store at ``path``, whose root has these attributes.

    A store that was made before a sensor was added lacks its arrays. Stores of versions before
    0.5.0 have no column of fingerprints.
    """
    fields = {row.path: row for row in schema.expand(config)}
    place = place_of(path)
    if FINGERPRINT not in attributes and not (place / schema.FINGERPRINT.path).exists():
        del fields[schema.FINGERPRINT.path]
    try:
        document = parsed((place / schema.DIGESTS.path / "zarr.json").read_bytes(DOCUMENT))
    except (OSError, ValueError, RefusedFileError):
        return fields
    recorded = recorded_arrays(document) if is_intact(document) else ()
    if not recorded:
        return fields
    known = {*recorded, *schema.NOT_IN_AN_EPISODE}
    return {name: field for name, field in fields.items() if name in known}


def recorded_arrays(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the paths of the arrays that have digests, in the order of the digests.

    Args:
        document: the ``zarr.json`` of the array of digests. If it lists no path, another number
            of paths than the array has columns, or a path twice, the result is empty.
    """
    paths, shape = document["attributes"].get("arrays"), document.get("shape")
    if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
        return ()
    is_whole = isinstance(shape, list) and shape[1:] == [len(paths)] == [len(set(paths))]
    return tuple(paths) if is_whole else ()


def place_in(node: zarr.Group | zarr.Array[Any]) -> Place:
    """Return the place of a group or an array of a store."""
    store = node.store
    assert isinstance(store, AtomicStore)
    return store.place / node.path


def open_array(root: zarr.Group, path: str) -> zarr.Array[Any]:
    """Return an array of a store.

    Raises:
        StoreError: if it is missing or damaged.
    """
    try:
        content = (place_in(root) / path / "zarr.json").read_bytes(DOCUMENT)
        # Zarr's own way starts a task in another thread for each array.
        place = StorePath(root.store, path)
        return zarr.Array(zarr.AsyncArray(metadata=_metadata(content), store_path=place))
    except (FileNotFoundError, NotADirectoryError):
        what = f"array {path}: zarr.json is missing; run grasp-factory verify on it, and repair"
        raise StoreError(f"{_where(root)} is damaged: {what}") from None
    except NO_DAMAGE:
        raise
    except Exception as error:  # Zarr raises any exception at damaged metadata
        what = f"array {path}: zarr.json is invalid: {first_line(error)}"
        raise StoreError(f"{_where(root)} is damaged: {what}") from None


def _metadata(content: bytes) -> ArrayV3Metadata:
    """Return the metadata that a ``zarr.json`` holds, with attributes that may be changed."""
    metadata = copy.copy(_parsed(content))
    object.__setattr__(metadata, "attributes", dict(metadata.attributes))
    return metadata


@lru_cache(maxsize=256)
def _parsed(content: bytes) -> ArrayV3Metadata:
    array = zarr.AsyncArray.from_dict(StorePath(MemoryStore()), parsed(content))
    if not isinstance(array.metadata, ArrayV3Metadata):
        raise ValueError(f"zarr_format {array.metadata.zarr_format}, valid: 3")
    metadata = copy.copy(array.metadata)
    object.__setattr__(metadata, "codecs", bounded(metadata.codecs))
    return metadata


def read_array(array: zarr.Array[Any], *selection: int | slice) -> NDArray[Any]:
    """Return values of an array of a store.

    Raises:
        StoreError: if they are damaged.
        LimitError: if they are too many; a selection is not measured.
    """
    if not selection:
        check_whole(array, f"{_where(array)}/{array.path}")
    try:
        with ending_failed_reads():
            return np.asarray(array[selection])
    except StorageError:
        raise
    except Exception as error:  # decoders raise any exception at damaged bytes
        what = f"{array.path}{_span(selection)} cannot be read: {first_line(error)}"
        clear_frames(error.__traceback__)  # they would keep the chunk in memory, in a cycle
    # Not in the handler above: the error would keep what the decoders have read in memory.
    raise StoreError(f"{_where(array)}: {what}")


def _span(selection: tuple[int | slice, ...]) -> str:
    first = selection[0] if selection else None
    if not isinstance(first, slice) or first.start is None:
        return ""
    return f" of episodes {first.start} to {first.stop - 1}"


def _where(node: zarr.Group | zarr.Array[Any]) -> str:
    return str(node.store)


def first_line(error: Exception) -> str:
    """Return an error's text for a message of one line."""
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:  # an optional library
        return "none"
