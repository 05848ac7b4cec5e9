"""The view of a camera above the table: its middle part, resampled to a size, without holes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import UNKNOWN, Label
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix, transform
from grasp_factory.errors import UsageError
from grasp_factory.robots import gripper_of
from grasp_factory.writers.exporters.grasp_rectangle import GraspRectangle, grasp_rectangle
from grasp_factory.writers.exporters.images import camera_of
from grasp_factory.writers.exporters.selection import Selection

OVERHEAD = "overhead"
"""The predefined camera that looks straight down."""
INPAINT_RADIUS = 1
"""Pixels; GG-CNN fills holes with it: https://github.com/dougsm/ggcnn, DepthImage.inpaint."""
NO_GRASP = "no grasp was planned"
NOT_MEASURED = "the pose of the grasp was not measured"
NO_CALIBRATION = "its camera was not calibrated"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OverheadView:
    """The image before the attempt, resampled: every pixel has the value of the nearest one."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.float32]
    """(H, W) metres along the optical axis; holes are filled."""
    objects: NDArray[np.uint8]
    """(H, W), 255 at objects, 0 elsewhere."""
    K: Array
    """Intrinsics, (3, 3) pixels."""
    T_world_camera: Array
    """(4, 4), OpenCV axes."""

    def rectangle(self, episode: Episode) -> GraspRectangle | None:
        """Return the rectangle of the episode's grasp; None if the camera does not see its TCP."""
        found = rectangle_in(episode, self.K, self.T_world_camera)
        height, width = self.depth.shape
        is_inside = found and 0.0 <= found.x <= width - 1.0 and 0.0 <= found.y <= height - 1.0
        return found if is_inside else None


def rectangle_in(episode: Episode, K: Array, T_world_camera: Array) -> GraspRectangle | None:
    """Return the rectangle of an episode's grasp in an image; None if it is behind the camera."""
    columns = episode.columns
    opening, jaw = float(columns["grasp_width"]), gripper_of(episode.spec.robot).pad_size[0]
    return grasp_rectangle(grasp_pose(episode), opening, jaw, K, T_world_camera)


def grasp_pose(episode: Episode) -> Array:
    """Return the pose of the TCP in the world frame, (4, 4)."""
    columns = episode.columns
    return transform(quat_xyzw_to_matrix(columns["grasp_quat_xyzw"]), columns["grasp_position"])


def overhead_camera(episodes: Selection, name: str) -> str:
    """Return the camera that a setting names; ``overhead`` for an empty text.

    Raises:
        UnknownNameError: naming the cameras.
        UsageError: if the text is empty and there is no such camera.
    """
    cameras = episodes.config.cameras
    if not name and OVERHEAD not in cameras:
        raise UsageError(
            f"{episodes.sources[0].path} has no camera {OVERHEAD}, and the format needs a view from"
            f" above: generate a dataset with --camera {OVERHEAD}, or choose one of"
            f" {', '.join(sorted(cameras))} with --option camera=NAME"
        )
    return camera_of(episodes, name or OVERHEAD)


def without_grasp(episodes: Selection, cameras: Sequence[str]) -> Mapping[str, NDArray[np.bool_]]:
    """Return which episodes have no grasp or no calibration of a camera, (n,), by the reason."""
    names = ("grasp_position", "grasp_quat_xyzw", "grasp_width")
    values = [episodes.column(name).reshape(len(episodes), -1) for name in names]
    no_grasp = np.isnan(np.concatenate(values, axis=1)).any(axis=1)
    real = episodes.is_real
    return {
        NO_GRASP: no_grasp & ~real,
        NOT_MEASURED: no_grasp & real,
        NO_CALIBRATION: episodes.without_calibration(cameras),
    }


def overhead_view(frames: CameraFrames, size: tuple[int, int], zoom: float) -> OverheadView:
    """Return the middle part of a camera's image before the attempt, resampled to a size.

    Args:
        frames: of the camera.
        size: width and height of the result, pixels. The part has this ratio of sides.
        zoom: 1 for the largest part that fits into the image, 2 for half of its sides, ...
    """
    height, width = frames.depth[0].shape
    share = min(width / size[0], height / size[1]) / zoom
    across, down = (_Span.middle(n, m, share) for n, m in ((width, size[0]), (height, size[1])))
    rows, columns = down.samples(), across.samples()
    labels = frames.segmentation[0]
    is_object = (labels >= Label.TARGET) & (labels != UNKNOWN)
    objects = np.where(is_object, np.uint8(255), np.uint8(0))
    K = frames.intrinsics.copy()
    K[0, 0], K[0, 2] = K[0, 0] / across.step, across.place(K[0, 2])
    K[1, 1], K[1, 2] = K[1, 1] / down.step, down.place(K[1, 2])
    return OverheadView(
        rgb=frames.rgb[0].take(rows, 0).take(columns, 1),
        depth=without_holes(frames.depth[0]).take(rows, 0).take(columns, 1),
        objects=objects.take(rows, 0).take(columns, 1),
        K=K,
        T_world_camera=frames.T_world_camera[0],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Span:
    """A part of the columns (or rows) of an image, in another number of pixels."""

    start: float
    """Its edge, in pixels from the image's edge."""
    step: float
    """Pixels of the image for each of its pixels."""
    size: int
    """Number of its pixels."""

    @classmethod
    def middle(cls, length: int, size: int, step: float) -> _Span:
        return cls(start=(length - size * step) / 2.0, step=step, size=size)

    def samples(self) -> NDArray[np.intp]:
        """Return the image's column for each of its columns, (size,)."""
        centres = self.start + (np.arange(self.size) + 0.5) * self.step
        return np.asarray(np.floor(centres), np.intp)

    def place(self, pixel: Any) -> Any:
        """Return where a coordinate of the image lies; integers are at the centres of pixels."""
        return (pixel + 0.5 - self.start) / self.step - 0.5


def without_holes(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a depth image (H, W) in which pixels without depth have that of their surroundings.

    A depth of 0 or less, NaN or infinity counts as none; without any depth, the result is 0.
    """
    has_depth = np.isfinite(depth) & (depth > 0.0)
    if has_depth.all():
        return depth
    if not has_depth.any():
        return np.zeros_like(depth)
    known = np.where(has_depth, depth, np.float32(0.0))
    deepest = known.max()  # OpenCV wants values of at most 1
    holes = (~has_depth).astype(np.uint8)
    filled = cv2.inpaint(known / deepest, holes, INPAINT_RADIUS, cv2.INPAINT_NS) * deepest
    return np.where(has_depth, depth, filled)
