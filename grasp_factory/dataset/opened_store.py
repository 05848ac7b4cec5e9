"""Opening a store for reading: its attributes, its config and its arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.freed_memory import keep_freed_memory
from grasp_factory.core.schema import Field
from grasp_factory.dataset.checked_reader import checked_arrays
from grasp_factory.dataset.row_codec import NEEDED
from grasp_factory.dataset.row_integrity import digested_paths, must_have_fingerprints
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import SOURCES, open_store


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenedStore:
    """The parts of a store that a dataset reads."""

    config: FactoryConfig
    attributes: Mapping[str, Any]
    """All root attributes: seed, versions, conventions, ..."""
    arrays: Mapping[str, StoredArray]
    """By path."""
    fields: Mapping[str, Field]
    """The fields of the arrays, by path."""


def opened(path: Path, *, checked: bool) -> OpenedStore:
    """Open the store at ``path``.

    Args:
        path: The path of the store.
        checked: Whether the arrays compare values with their checksums as they are read.

    Raises:
        StoreMismatchError: if there is no store, or it has a newer version.
        StoreError: if the store is damaged.
    """
    keep_freed_memory()
    root, config = open_store(path, mode="r")
    needed = {f"episodes/{name}" for name in NEEDED}
    fields = {row.path: row for row in schema.expand(config)}
    arrays = open_arrays(root, config, fields, needed)
    for name in sorted(_named(arrays, fields) - {"", *arrays}):
        what = f"array {name} is missing; run grasp-factory verify on it, and repair"
        raise StoreError(f"{path} is damaged: {what}")
    if checked:
        seed = None if SOURCES in root.attrs else config.seed
        required = must_have_fingerprints(root.attrs)
        arrays = checked_arrays(path, arrays, fields, seed, has_fingerprints=required)
    return OpenedStore(
        config=config,
        attributes=root.attrs.asdict(),
        arrays=arrays,
        fields={row_path: row for row_path, row in fields.items() if row_path in arrays},
    )


def _named(arrays: Mapping[str, StoredArray], fields: Mapping[str, Field]) -> set[str]:
    """Return the arrays that others name: columns of lengths, and what the digests are of.

    Columns among the latter may be absent: they are read where they are needed.
    """
    large = {path for path, field in fields.items() if field.length_column or field.is_image}
    return {fields[path].length_column for path in arrays} | (large & set(digested_paths(arrays)))
