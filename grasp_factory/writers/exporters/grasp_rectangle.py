"""A grasp as a rectangle in an image, as GG-CNN and other grasp detectors describe it.

The rectangle was introduced by Jiang, Moseson and Saxena, "Efficient Grasping from RGBD Images",
2011. Its length is the opening of the gripper, its width that of the jaws.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.camera import project
from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.core.linear import length, product


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspRectangle:
    """A grasp as a rectangle in an image; pixels are sampled at integer coordinates."""

    x: float
    """Column of the TCP, pixels."""
    y: float
    """Row of the TCP, pixels."""
    angle: float
    """Direction of closing in the image, rad, -pi/2 to pi/2: 0 along a row, positive from the
    image's right to its lower side."""
    opening: float
    """Distance between the pads, pixels: the rectangle's length, along the direction of closing."""
    jaw: float
    """Width of a pad, pixels: the rectangle's other side."""
    depth: float
    """Of the TCP along the optical axis, metres."""
    tilt: float
    """Angle between the approach and the camera's optical axis, rad."""

    def corners(self) -> Array:
        """Return the corners as (x, y), (4, 2) pixels; the first edge is along the closing."""
        along = np.array([math.cos(self.angle), math.sin(self.angle)]) * self.opening / 2.0
        across = np.array([-math.sin(self.angle), math.cos(self.angle)]) * self.jaw / 2.0
        centre = np.array([self.x, self.y])
        signs = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
        return np.array([centre + a * along + b * across for a, b in signs])


def grasp_rectangle(
    T_world_grasp: Array, opening: float, jaw: float, K: Array, T_world_camera: Array
) -> GraspRectangle | None:
    """Return a grasp's rectangle; None if a part of the grasp is not in front of the camera.

    Args:
        T_world_grasp: pose of the TCP, (4, 4): +z approaches, +y closes.
        opening: distance between the pads, metres.
        jaw: width of a pad along the TCP's x, metres.
        K: intrinsics of the image, (3, 3) pixels.
        T_world_camera: pose of the camera, (4, 4), OpenCV axes.
    """
    T_camera_grasp = product(inverse(T_world_camera), T_world_grasp)
    x, y = jaw / 2.0, opening / 2.0
    ends = [[0.0, 0.0, 0.0], [0.0, -y, 0.0], [0.0, y, 0.0], [-x, 0.0, 0.0], [x, 0.0, 0.0]]
    points = apply(T_camera_grasp, np.array(ends))
    if points[:, 2].min() <= 0.0:
        return None
    centre, left, right, near, far = project(points, K)
    across, down = right - left
    return GraspRectangle(
        x=float(centre[0]),
        y=float(centre[1]),
        angle=_half_turn(math.atan2(down, across)),
        opening=length(right - left),
        jaw=length(far - near),
        depth=float(points[0, 2]),
        tilt=math.acos(min(1.0, max(-1.0, float(T_camera_grasp[2, 2])))),
    )


def _half_turn(angle: float) -> float:
    """Return the angle in [-pi/2, pi/2) of the same line."""
    return (angle + math.pi / 2.0) % math.pi - math.pi / 2.0
