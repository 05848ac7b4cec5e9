"""The objects of an episode as the cameras see them: poses, masks and boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraFrames, Episode, ObjectSpec
from grasp_factory.core.geometry import Array, inverse, pose_matrices
from grasp_factory.core.linear import product
from grasp_factory.core.splits import SPLITS
from grasp_factory.writers.exporters.selection import Selection

TIMES = ("before", "after")
"""Names of the frames 0 and 1 of a camera."""
REAL_OBJECTS = "its objects are real: there are no models and poses of them"
NO_SPLIT = f"its split is not one of {', '.join(SPLITS)}"


def of_no_split(episodes: Selection, settings: Any) -> dict[str, NDArray[np.bool_]]:
    """Exclude episodes of an unknown split: the split is the name of a folder or a file."""
    return {NO_SPLIT: ~np.isin(episodes.column("split").tolist(), SPLITS)}


def of_real_objects(episodes: Selection) -> dict[str, NDArray[np.bool_]]:
    """Exclude real episodes: what was grasped has neither a model nor a pose."""
    return {REAL_OBJECTS: episodes.is_real}


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectView:
    """An object in one image."""

    recipe: ObjectSpec
    T_camera_object: Array
    """(4, 4); the object's own frame, metres, OpenCV axes of the camera."""
    mask: NDArray[np.bool_]
    """Its visible pixels, (H, W)."""
    visibility: float
    """Share of its pixels in the image that nothing hides; 0 where the store has no value."""


def object_views(episode: Episode, frames: CameraFrames, k: int) -> list[ObjectView]:
    """Return the objects of an episode in an image, the target first.

    An object whose pose is not finite is not among them.

    Args:
        episode: the episode.
        frames: the images of a camera.
        k: 0 for the image before the attempt, 1 for that after it.
    """
    poses = world_poses(episode, k)[: len(episode.spec.objects)]
    with np.errstate(all="ignore"):  # of what somebody made up
        found = product(inverse(frames.T_world_camera[k]), pose_matrices(poses))
    return [
        ObjectView(
            recipe=recipe,
            T_camera_object=T_camera_object,
            mask=frames.segmentation[k] == Label.TARGET + m,
            visibility=float(np.nan_to_num(frames.visibility[k, m])),
        )
        for m, (recipe, T_camera_object) in enumerate(zip(episode.spec.objects, found, strict=True))
        if np.isfinite(T_camera_object).all()
    ]


def world_poses(episode: Episode, k: int) -> Array:
    """Return the poses (M, 7) of the objects in frame k: position (m) and quat_xyzw, in the world.

    After the attempt it is the last record of the streams, up to one period of them before the
    image. If the robot did not move, both images are the same.
    """
    if k == 0 or not episode.n_steps:
        return np.asarray(episode.columns["object_rest_pose"])
    return np.asarray(episode.streams["object_pose"][-1], np.float64)


def box_of(mask: NDArray[np.bool_]) -> list[int]:
    """Return the box of a mask (H, W) as [x, y, width, height] in pixels; zeros if it is empty."""
    return list(cv2.boundingRect(mask.astype(np.uint8)))
