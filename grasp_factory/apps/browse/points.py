"""Point clouds as bytes, with few enough points for smooth rotation in a browser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.signals.point_cloud import PointCloud

MOST_POINTS = 60_000
NEAR_TABLE = 1.0
"""Metres of floor that are shown around the other points; an endless floor would hide them."""


def cloud_bytes(cloud: PointCloud) -> bytes:
    """Return a cloud as uint32 n, float32 xyz (n, 3), uint8 rgb (n, 3), uint8 label (n).

    If there are more than ``MOST_POINTS``, an evenly spaced subset is returned.
    """
    shown = np.flatnonzero(_is_shown(cloud))
    if len(shown) > MOST_POINTS:
        shown = shown[np.linspace(0, len(shown) - 1, MOST_POINTS).astype(np.intp)]
    return b"".join(
        (
            np.uint32(len(shown)).astype("<u4").tobytes(),
            cloud.points[shown].astype("<f4").tobytes(),
            cloud.rgb[shown].tobytes(),
            cloud.labels[shown].tobytes(),
        )
    )


def visible_points(dataset: Dataset, row: int, camera: str | None, frame: int) -> PointCloud:
    """Return the cloud of a camera, None for all; without points if one was not calibrated.

    Raises:
        StoreError: if the row is missing, quarantined or damaged.
    """
    cameras = [camera] if camera else list(dataset.config.cameras)
    known = [values for name in cameras for values in dataset.calibration(row, name, frame)]
    if any(np.isnan(values).any() for values in known):
        nothing = np.empty((0, 3))
        return PointCloud(
            points=nothing, rgb=nothing.astype(np.uint8), labels=np.empty(0, np.uint8)
        )
    return dataset.point_cloud(row, camera, frame)


def _is_shown(cloud: PointCloud) -> NDArray[np.bool_]:
    """Return whether each point is not on the floor, or is on the floor near such points."""
    is_floor: NDArray[np.bool_] = cloud.labels == Label.FLOOR
    if is_floor.all():
        return is_floor
    xy = cloud.points[:, :2]
    others = xy[~is_floor]
    low, high = others.min(axis=0) - NEAR_TABLE, others.max(axis=0) + NEAR_TABLE
    is_near = ((xy >= low) & (xy <= high)).all(axis=1)
    return np.asarray(is_near | ~is_floor, np.bool_)
