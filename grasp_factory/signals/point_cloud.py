"""Point clouds: coloured and labelled points from camera images, in a frame that can be chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import deproject_pixels
from grasp_factory.core.enums import Label, label_names
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import Array, apply
from grasp_factory.errors import lookup

FRAMES: Mapping[str, str] = {
    "world": "the robot's base; z = 0 is the table top",
    "camera": "the one camera's, OpenCV axes",
    "tcp": "the TCP's as it was at the image: +z approaches, +y closes",
    "grasp": "the grasp's: where the TCP was to close",
    "object": "the target's own, as it lay at the image",
}
"""Frames in which a cloud can be, by name."""

FAR_SHARE = 1.0 - 1e-4
"""Share of the far plane's distance: at this depth or more, nothing is visible.

z-buffers do not represent the far plane exactly.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointCloud:
    """K points, in the order of the cameras and of their pixels, row by row."""

    points: Array
    """(K, 3) metres."""
    rgb: NDArray[np.uint8]
    """(K, 3)."""
    labels: NDArray[np.uint8]
    """(K,), values of ``Label``."""

    def __len__(self) -> int:
        """Return K."""
        return len(self.labels)

    def moved(self, T: Array) -> PointCloud:
        """Return the cloud with its points mapped by a transform (4, 4)."""
        return replace(self, points=apply(T, self.points))


def visible_cloud(image: CameraImage, far: float, shown: NDArray[np.bool_]) -> PointCloud:
    """Return the cloud, world frame, of an image's pixels that have a depth and a label ``shown``.

    Args:
        image: Image of the camera. A depth of 0, NaN or infinity counts as no depth.
        far: Far plane, metres: at this depth or more, nothing is visible.
        shown: Whether to include a label, by its value, (256,); see ``label_mask``.
    """
    depth = image.depth
    has_depth = (depth > 0.0) & (depth < far * FAR_SHARE)
    v, u = np.nonzero(has_depth & shown[image.segmentation])
    points = deproject_pixels(u, v, depth[v, u].astype(np.float64), image.intrinsics)
    return PointCloud(
        points=apply(image.T_world_camera, points),
        rgb=image.rgb[v, u],
        labels=image.segmentation[v, u],
    )


def joined(clouds: Sequence[PointCloud]) -> PointCloud:
    """Join one or more clouds in the same frame into one."""
    return PointCloud(
        points=np.concatenate([cloud.points for cloud in clouds]),
        rgb=np.concatenate([cloud.rgb for cloud in clouds]),
        labels=np.concatenate([cloud.labels for cloud in clouds]),
    )


def label_mask(name: str, objects: int) -> NDArray[np.bool_]:
    """Return whether a label belongs to a part of the scene, by its value, (256,).

    Args:
        name: ``scene`` for everything, ``objects`` for the target and the other objects, or the
            name of one label: target, object_1, table, gripper, ...
        objects: How many objects there are in the scene.

    Raises:
        UnknownNameError: listing the names.
    """
    words = label_names(objects)
    parts = {word: slice(value, value + 1) for value, word in enumerate(words)}
    del parts[words[Label.BACKGROUND]]  # the background has no points
    parts |= {"scene": slice(None), "objects": slice(Label.TARGET, len(words))}
    chosen = np.zeros(256, np.bool_)
    chosen[lookup(parts, "part of the scene", name)] = True
    return chosen
