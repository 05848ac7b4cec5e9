"""All data of one episode that the page shows, except its images and series."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasp_factory.apps.browse.image_files import depth_range
from grasp_factory.apps.browse.open_stores import OpenStore
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.plausible import pad_size
from grasp_factory.errors import GraspFactoryError

_ELSEWHERE = ("spec", "array_crc32c", "status", "error")
"""Columns that are shown in another form, or that mean nothing to a user."""


def episode(opened: OpenStore, row: int, indexed: Mapping[str, Any]) -> dict[str, Any]:
    """Return a committed or quarantined episode as plain values.

    Args:
        opened: Its store.
        row: Its row.
        indexed: Its row in the index.

    Raises:
        StoreError: if it is damaged.
    """
    log = opened.log
    out = {
        "store": indexed["store"],
        "row": row,
        "status": indexed["status"],
        "version": opened.version(row),
        "index": indexed,
        "annotation": to_plain(log.of(row)),
        "history": to_plain(log.history(row)),
    }
    if indexed["status"] == "quarantined":
        return out | {"error": indexed.get("error"), "spec": _spec_of_quarantined(opened, row)}
    dataset = opened.dataset
    return out | {
        "spec": to_plain(dataset.spec(row)),
        "columns": _columns(dataset, row),
        "cameras": {camera: _camera(opened, row, camera) for camera in dataset.config.cameras},
        "depth_range": {c: depth_range(dataset, row, c) for c in dataset.config.cameras},
        "grasp": _grasp(dataset, row),
        "pad_size": pad_size(dataset.attributes),
        "objects": dataset.value(row, "object_ids").tolist(),
    }


def _spec_of_quarantined(opened: OpenStore, row: int) -> Any:
    """Return a row's recipe; None if it is damaged, which may be why the row is quarantined."""
    try:
        return to_plain(opened.dataset.spec(row))
    except GraspFactoryError:
        return None


def _columns(dataset: Dataset, row: int) -> dict[str, Any]:
    return {c: dataset.value(row, c) for c in dataset.columns if c not in _ELSEWHERE}


def _camera(opened: OpenStore, row: int, camera: str) -> dict[str, Any]:
    dataset = opened.dataset
    width, height = dataset.config.resolution
    poses = [dataset.calibration(row, camera, frame) for frame in (0, 1)]
    recipe = dataset.spec(row).cameras[camera]
    has_video = f"videos/{camera}/rgb" in opened.arrays
    return {
        "width": width,
        "height": height,
        "video_frames": int(dataset.value(row, "n_video")) if has_video else 0,
        "intrinsics": poses[0][0],
        "T_world_camera": [pose for _, pose in poses],
        "near": recipe.near,
        "far": recipe.far,
    }


def _grasp(dataset: Dataset, row: int) -> dict[str, Any] | None:
    """Return the grasp that was planned; None if there was none."""
    position = dataset.value(row, "grasp_position")
    if np.isnan(position).any():
        return None
    return {
        "position": position,
        "quat_xyzw": dataset.value(row, "grasp_quat_xyzw"),
        "width": dataset.value(row, "grasp_width"),
    }
