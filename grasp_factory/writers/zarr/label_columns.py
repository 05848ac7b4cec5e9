"""Labels that are added to a store: other thresholds applied to the same measurements.

``labels/NAME/outcome`` and ``labels/NAME/success`` have one value for each row of the store.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.limits import LABELS as LABELS_LIMIT
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.place_tree import entries, files_below, fsync_tree
from grasp_factory.core.regular_file import irregular
from grasp_factory.core.serialization import is_number
from grasp_factory.errors import StoreError, UsageError, shown
from grasp_factory.writers.zarr.atomic_store import AtomicStore
from grasp_factory.writers.zarr.header import open_array, open_store, read_array
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


def label_folders(store: Place) -> list[str]:
    """Return the names of a store's added labels, complete or not, sorted; no folders of a user.

    A label has the folder of a column, or sealed metadata.

    Raises:
        IrregularFileError: if there is a link among them.
        LimitError: if they are too many.
    """
    labels = store / LABELS
    if not labels.is_dir():
        return []
    found = entries(labels)
    for name in found.others:
        if not name.startswith("."):
            raise irregular(labels.path / name)
    names = [name for name in found.folders if not name.startswith(".")]
    LABELS_LIMIT.check(len(names), labels)
    return [name for name in names if _is_label(labels / name)]


def _is_label(folder: Place) -> bool:
    has_column = any((folder / column).is_dir() for column in LABEL_COLUMNS)
    return has_column or is_sealed(folder / "zarr.json")


def added_labels(store: Path) -> list[str]:
    """Return the names of a store's added labels that have metadata, sorted.

    Raises:
        IrregularFileError: if there is a link among them.
        LimitError: if they are too many.
    """
    place = place_of(store)
    return [n for n in label_folders(place) if (place / LABELS / n / "zarr.json").exists()]


def added_columns(store: Path) -> dict[str, zarr.Array[Any]]:
    """Return the arrays of all added labels by path.

    Raises:
        StoreError: if one is damaged.
    """
    root, _ = open_store(store, mode="r")
    labels = added_labels(store)
    paths = [f"{LABELS}/{name}/{column}" for name in labels for column in LABEL_COLUMNS]
    return {path: open_array(root, path) for path in paths}


def label_thresholds(path: str, attributes: Mapping[str, Any]) -> dict[str, float | None]:
    """Return the thresholds of an added label from the attributes of one of its arrays.

    Args:
        path: The label, for the message.
        attributes: As they are stored.

    Raises:
        StoreError: unless they are finite numbers by name, or None.
    """
    found = attributes.get("thresholds")
    if not isinstance(found, Mapping) or not all(map(_is_threshold, found.values())):
        what = f"thresholds: got {shown(found)}, valid: finite numbers by name"
        raise StoreError(f"{path} is damaged: {what}; remove it, and relabel if you need it")
    return dict(found)


def _is_threshold(value: Any) -> bool:
    return value is None or (is_number(value) and abs(value) <= sys.float_info.max)


def read_label(root: zarr.Group, path: str, rows: int) -> NDArray[Any]:
    """Return a column of an added label, (K,), of a store with so many rows.

    Raises:
        StoreError: if it is damaged, or has more rows than the store.
        LimitError: if it is too large.
    """
    array = open_array(root, path)
    if array.ndim != 1 or array.shape[0] > rows:
        shape = " x ".join(map(str, array.shape))
        raise StoreError(f"{root.store} is damaged: {path} is of {shape} rows, valid: up to {rows}")
    return read_array(array)


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
    target = place_of(path) / LABELS / name
    if target.exists():
        raise UsageError(f"{path} has a label {name!r} already: choose another name")
    root, _ = open_store(path, mode="r+")
    root.require_group(LABELS)
    with StagingFolder(target, CREATING).building() as folder:
        _write_columns(folder, outcome, {"thresholds": dict(thresholds)})
        for metadata in files_below(folder):
            if metadata.name == "zarr.json":
                seal(metadata)
        fsync_tree(folder)


def _write_columns(
    folder: Place, outcome: NDArray[np.uint8], attributes: Mapping[str, Any]
) -> None:
    group = zarr.create_group(AtomicStore(folder), zarr_format=3, attributes=dict(attributes))
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
