"""Labels that are added to a store: other thresholds applied to the same measurements.

``labels/NAME/outcome`` and ``labels/NAME/success`` have one value for each row of the store.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core.atomic_file import fsync_tree
from grasp_factory.core.enums import Outcome, names
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.header import open_array, open_store
from grasp_factory.writers.zarr.metadata_checksum import (
    VALUES_SEAL,
    is_sealed,
    seal,
    values_digest,
)
from grasp_factory.writers.zarr.staging import CREATING, StagingFolder

LABELS = "labels"
"""The group of added labels."""
LABEL_COLUMNS = ("outcome", "success")
LONGEST_NAME = 64
NOT_LABELLED = 255
"""Outcome of rows that held no episode when the label was made."""


def is_label(store: Path, name: str) -> bool:
    """Return whether ``labels/NAME`` is an added label, complete or not, and not a user's folder.

    It is one if it has the folder of a column, or sealed metadata.
    """
    folder = store / LABELS / name
    if name.startswith(".") or not folder.is_dir():
        return False
    has_column = any((folder / column).is_dir() for column in LABEL_COLUMNS)
    return has_column or is_sealed(folder / "zarr.json")


def added_labels(store: Path) -> list[str]:
    """Return the names of a store's added labels, sorted."""
    found = (file.parent.name for file in (store / LABELS).glob("*/zarr.json"))
    return sorted(name for name in found if is_label(store, name))


def added_columns(store: Path) -> dict[str, zarr.Array[Any]]:
    """Return the arrays of all added labels by path.

    Raises:
        StoreError: if one is damaged.
    """
    root, _ = open_store(store, mode="r")
    labels = added_labels(store)
    paths = [f"{LABELS}/{name}/{column}" for name in labels for column in LABEL_COLUMNS]
    return {path: open_array(root, path) for path in paths}


def write_label(
    path: Path, name: str, outcome: NDArray[np.uint8], thresholds: Mapping[str, Any]
) -> None:
    """Write ``labels/NAME/outcome`` and ``success``, (N,) each; both or none.

    Raises:
        UsageError: if the name is no identifier, or the store has a label of that name.
        StoreMismatchError: if a file that is not ours is where the label is built.
    """
    if not name.isidentifier() or len(name) > LONGEST_NAME:
        valid = f"letters, digits and _, at most {LONGEST_NAME}"
        raise UsageError(f"label name {name[:LONGEST_NAME]!r}, valid: {valid}")
    target = path / LABELS / name
    if target.exists():
        raise UsageError(f"{path} has a label {name!r} already: choose another name")
    root, _ = open_store(path, mode="r+")
    root.require_group(LABELS)
    with StagingFolder(target, CREATING).building() as folder:
        _write_columns(folder, outcome, {"thresholds": dict(thresholds)})
        for metadata in folder.rglob("zarr.json"):
            seal(metadata)
        fsync_tree(folder)


def _write_columns(folder: Path, outcome: NDArray[np.uint8], attributes: Mapping[str, Any]) -> None:
    group = zarr.create_group(folder, zarr_format=3, attributes=dict(attributes))
    columns: dict[str, tuple[NDArray[Any], Any, dict[str, Any]]] = {
        "outcome": (outcome, NOT_LABELLED, {"names": names(Outcome)}),
        "success": (outcome == Outcome.SUCCESS, False, {}),
    }
    for column, (values, fill, more) in columns.items():
        array = group.create_array(
            column, shape=values.shape, dtype=values.dtype, chunks=(max(1, len(values)),),
            fill_value=fill, dimension_names=["episode"],
            attributes={**attributes, **more, VALUES_SEAL: values_digest(values)},
        )  # fmt: skip
        array[:] = values
