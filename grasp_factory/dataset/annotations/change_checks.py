"""Checks of changes against the store: its rows, its cameras and the size of its images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.serialization import check
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.field_arrays import open_arrays
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.writer import MISSING


def check_place(store: Path, rows: Sequence[int], changes: Sequence[tuple[str, Any]]) -> None:
    """Check that the store at ``store`` has these rows, and the images of marks.

    Args:
        store: the path of the store.
        rows: ascending integers, at least one.
        changes: kinds and values that have passed ``values.checked``.

    Raises:
        StoreMismatchError: if there is no store.
        UsageError: naming the row, or the part of a mark, that the store does not have.
        StoreError: if the store is damaged.
    """
    root, config = open_store(store, mode="r")
    path = schema.STATUS.path
    status = open_arrays(root, config, {path: schema.STATUS}, {path})[path]
    _check_rows(store, status, rows, config.block_size)
    for kind, value in changes:
        if kind == "mark":
            _check_mark(config, value)


def _check_rows(store: Path, status: StoredArray, rows: Sequence[int], size: int) -> None:
    length = status.zarr.shape[0]
    for row in (rows[0], rows[-1]):
        if not 0 <= row < length:
            valid = f"0 to {length - 1}" if length else "none, the store is empty"
            raise UsageError(f"episode {row} of {store}: valid: {valid}")
    wanted = np.array(rows, np.int64)
    firsts = np.flatnonzero(np.diff(wanted // size)) + 1
    for mine in np.split(wanted, firsts):  # the rows of one block, whose file is read once
        found = status.read(mine[0], mine[-1] + 1)
        missing = mine[found[mine - mine[0]] == MISSING]
        if len(missing):
            what = f"episode {missing[0]} of {store} is missing"
            raise UsageError(f"{what}: only rows that are there can be annotated")


def _check_mark(config: FactoryConfig, mark: dict[str, Any]) -> None:
    cameras, (width, height) = config.cameras, config.resolution
    check(mark["camera"] in cameras, "mark.camera", mark["camera"], ", ".join(cameras))
    x, y, *sides = mark["pixels"]
    right, bottom = (x + sides[0], y + sides[1]) if sides else (x, y)
    ok = right <= width and bottom <= height
    check(ok, "mark.pixels", mark["pixels"], f"within the image, {width}x{height} pixels")
