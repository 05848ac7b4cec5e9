"""A grasp as key points in an image, as COCO has them.

Definition: https://cocodataset.org/#format-data, "Keypoint Detection".
"""

from __future__ import annotations

import numpy as np

from grasp_factory.core.camera import project
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, Pose, apply, inverse

KEY_POINTS = ("grasp_center", "finger_minus_y", "finger_plus_y")
"""The TCP of the grasp, and both ends of its opening along the TCP's y axis, which closes."""
SKELETON = ((2, 1), (1, 3))
"""Connected key points, which COCO counts from 1."""
NOT_LABELLED, HIDDEN, VISIBLE = 0, 1, 2
"""COCO's visibility of a key point."""


def key_points(episode: Episode, frames: CameraFrames) -> list[float]:
    """Return ``KEY_POINTS`` in the image before the attempt as [x, y, visibility, ...], pixels.

    A point is hidden if the depth image has something nearer at its pixel. Points are not labelled
    without a grasp, behind the camera or outside the image.
    """
    in_camera = apply(inverse(frames.T_world_camera[0]), grasp_points(episode))
    depth = frames.depth[0]
    found: list[float] = []
    for point in in_camera:
        x, y = project(point, frames.intrinsics) if point[2] > 0.0 else (np.nan, np.nan)
        is_inside = -0.5 <= x < depth.shape[1] - 0.5 and -0.5 <= y < depth.shape[0] - 0.5
        if not is_inside:
            found += [0.0, 0.0, NOT_LABELLED]
            continue
        is_hidden = depth[round(float(y)), round(float(x))] < point[2]
        found += [float(x), float(y), HIDDEN if is_hidden else VISIBLE]
    return found


def grasp_points(episode: Episode) -> Array:
    """Return ``KEY_POINTS`` in the world, (3, 3) metres; NaN without a grasp."""
    columns = episode.columns
    position, quat = columns["grasp_position"], columns["grasp_quat_xyzw"]
    half = float(columns["grasp_width"]) / 2.0
    if not (np.isfinite(position).all() and np.isfinite(quat).all() and np.isfinite(half)):
        return np.full((len(KEY_POINTS), 3), np.nan)
    T_world_tcp = Pose(tuple(position), tuple(quat)).matrix()
    return apply(T_world_tcp, np.array([[0.0, 0.0, 0.0], [0.0, -half, 0.0], [0.0, half, 0.0]]))
