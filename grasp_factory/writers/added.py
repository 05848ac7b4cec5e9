"""Label columns that were added to a store later (see ``labels``), as arrays."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import zarr

from grasp_factory.writers.header import open_array, open_store

LABEL_COLUMNS = ("outcome", "success")


def added_labels(store: Path) -> list[str]:
    """Return the names of a store's added labels, sorted."""
    found = (store / "labels").glob("*/zarr.json")
    return sorted(file.parent.name for file in found if not file.parent.name.startswith("."))


def added_columns(store: Path) -> dict[str, zarr.Array[Any]]:
    """Return the arrays of all added labels by path.

    Raises:
        StoreError: if one is damaged.
    """
    root, _ = open_store(store, mode="r")
    names = added_labels(store)
    paths = [f"labels/{name}/{column}" for name in names for column in LABEL_COLUMNS]
    return {path: open_array(root, path) for path in paths}
