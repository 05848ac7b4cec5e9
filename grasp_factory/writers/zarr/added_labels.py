"""Label columns that were added to a store later (see ``labels``), as arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import zarr

from grasp_factory.writers.zarr.header import open_array, open_store
from grasp_factory.writers.zarr.metadata_checksum import is_sealed

LABEL_COLUMNS = ("outcome", "success")


def is_label(store: Path, name: str) -> bool:
    """Say whether ``labels/<name>`` is an added label, whole or not; people keep things there too.

    It is one if it has the folder of a column, or metadata that is as this package sealed it.
    """
    folder = store / "labels" / name
    if name.startswith(".") or not folder.is_dir():
        return False
    has_column = any((folder / column).is_dir() for column in LABEL_COLUMNS)
    return has_column or is_sealed(folder / "zarr.json")


def added_labels(store: Path) -> list[str]:
    """Return the names of a store's added labels, sorted."""
    found = (file.parent.name for file in (store / "labels").glob("*/zarr.json"))
    return sorted(name for name in found if is_label(store, name))


def added_columns(store: Path) -> dict[str, zarr.Array[Any]]:
    """Return the arrays of all added labels by path.

    Raises:
        StoreError: if one is damaged.
    """
    root, _ = open_store(store, mode="r")
    names = added_labels(store)
    paths = [f"labels/{name}/{column}" for name in names for column in LABEL_COLUMNS]
    return {path: open_array(root, path) for path in paths}
