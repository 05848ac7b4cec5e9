"""Label columns that came later: other thresholds over the same measurements."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome, names
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.files import fsync_tree
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, seal, values_digest

LONGEST_NAME = 64
NOT_LABELLED = 255
"""Outcome of rows that held no episode when the label was made."""


def write_label(
    path: Path, name: str, outcome: NDArray[np.uint8], thresholds: Mapping[str, Any]
) -> None:
    """Write ``labels/<name>/outcome`` and ``success``, (N,) each; all at once or not at all.

    Raises:
        UsageError: if the name is no identifier, or the store has a label of that name.
    """
    if not name.isidentifier() or len(name) > LONGEST_NAME:
        valid = f"letters, digits and _, at most {LONGEST_NAME}"
        raise UsageError(f"label name {name[:LONGEST_NAME]!r}, valid: {valid}")
    if (path / "labels" / name).exists():
        raise UsageError(f"{path} has a label {name!r} already: choose another name")
    root, _ = open_store(path, mode="r+")
    root.require_group("labels")
    aside = path / "labels" / f".{name}.creating"
    shutil.rmtree(aside, ignore_errors=True)  # what a killed run left
    attributes = {"thresholds": dict(thresholds)}
    group = zarr.create_group(aside, zarr_format=3, attributes=attributes)
    columns: dict[str, tuple[NDArray[Any], Any, dict[str, Any]]] = {
        "outcome": (outcome, NOT_LABELLED, {"names": names(Outcome)}),
        "success": (outcome == Outcome.SUCCESS, False, {}),
    }
    for column, (values, fill, more) in columns.items():
        array = group.create_array(
            column, shape=values.shape, dtype=values.dtype, chunks=(max(1, len(values)),),
            fill_value=fill, dimension_names=["episode"],
            attributes=attributes | more | {VALUES_SEAL: values_digest(values)},
        )  # fmt: skip
        array[:] = values
    for metadata in aside.rglob("zarr.json"):
        seal(metadata)
    fsync_tree(aside)
    os.replace(aside, path / "labels" / name)
