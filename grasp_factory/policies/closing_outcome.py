"""The contacts of the pads with a surface when the gripper closes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.elementary import arccos
from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.linear import norm, turned_back
from grasp_factory.policies.surface import Surface

PATCH_DEPTH = 0.003
"""Points up to this distance (metres) behind the first contact count as touched.

The resolution of the seen surfaces is coarse.
"""
POINT_SIZE = 0.002
"""Side of the patch that one point of a surface represents, metres."""


@dataclass(frozen=True, slots=True)
class Grip:
    """The two patches of the surface that the pads touch first."""

    shift: float
    """Distance along the closing axis from the TCP to the midpoint of the patches, metres."""
    span: float
    """Distance between the patches along the closing axis, metres."""
    angle: float
    """The larger angle between a patch's mean normal and the closing axis, rad."""
    size: float
    """Area of the smaller patch's bounding rectangle on its pad, square metres."""
    middle: Array
    """(3,) metres, world frame: the midpoint between the patches."""


def close_on(surface: Surface, T_world_tcp: Array, gripper: Gripper) -> Grip | None:
    """Return the contacts of the pads, or None if one of them touches nothing."""
    local = apply(inverse(T_world_tcp), surface.points)
    half_breadth, half_height = gripper.pad_size[0] / 2.0, gripper.pad_size[1] / 2.0
    between = (np.abs(local[:, 0]) < half_breadth) & (np.abs(local[:, 2]) < half_height)
    points, normals = local[between], turned_back(T_world_tcp[:3, :3], surface.normals[between])
    left, right = _meet(points, normals, 1.0), _meet(points, normals, -1.0)
    if left is None or right is None:
        return None
    foremost = left.foremost, -right.foremost
    middle = (left.middle + right.middle) / 2.0
    return Grip(
        shift=(foremost[0] + foremost[1]) / 2.0,
        span=foremost[0] - foremost[1],
        angle=max(left.angle, right.angle),
        size=min(left.size, right.size),
        middle=apply(T_world_tcp, middle[None])[0],
    )


@dataclass(frozen=True, slots=True)
class _Patch:
    foremost: float
    middle: Array
    angle: float
    size: float


def _meet(points: Array, normals: Array, side: float) -> _Patch | None:
    """Return the patch that the pad on one side (1 or -1 along y) touches, TCP frame.

    None if it touches nothing.
    """
    facing = side * normals[:, 1] > 0.0
    points, normals = points[facing], normals[facing]
    if not len(points):
        return None
    y = side * points[:, 1]
    foremost = float(y.max())
    touched = y > foremost - PATCH_DEPTH
    points, normal = points[touched], normals[touched].mean(axis=0)
    breadth, height = points[:, [0, 2]].max(axis=0) - points[:, [0, 2]].min(axis=0) + POINT_SIZE
    cosine = side * normal[1] / norm(normal)
    return _Patch(
        foremost, points.mean(axis=0), float(arccos(min(1.0, cosine))), float(breadth * height)
    )
