"""Random downward grasps around the target, with the distribution of the training data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.elementary import sincos
from grasp_factory.core.geometry import Array
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies.base import TIP_CLEARANCE, downward
from grasp_factory.policies.top_down import grasp_height

POINTS = 4000
"""Largest number of points of the target that are used, evenly spaced in their order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """The region of possible grasps: the target's visible points and the gripper."""

    points: Array
    """(N, 3) metres, world frame: at least one point of the target."""
    gripper: Gripper

    @property
    def middle(self) -> Array:
        """Centre of the bounding box of the points, x and y (2,), metres, world frame."""
        return np.asarray(self.points[:, :2].min(axis=0) + self.points[:, :2].max(axis=0)) / 2.0

    @property
    def heights(self) -> tuple[float, float]:
        """The lowest and the highest TCP height, metres.

        At the lowest the tips are just above the table; the highest is the target's highest point.
        """
        deepest = self.gripper.tip_distance + TIP_CLEARANCE
        return deepest, max(deepest, float(self.points[:, 2].max()))

    @classmethod
    def around(cls, points: Array, gripper: Gripper) -> Region:
        """Return the region for a target with points (N, 3), metres, world frame."""
        rows = np.linspace(0, len(points) - 1, min(len(points), POINTS)).astype(int)
        return cls(points=points[rows], gripper=gripper)


@dataclass(frozen=True, slots=True)
class Candidates:
    """Downward grasps."""

    tcp: Array
    """Position of the TCP, (K, 3) metres, world frame."""
    yaw: Array
    """(K,) rad: angle of the closing direction about the world's z axis."""
    width: Array
    """(K,) distance between the pads before closing, metres."""

    def __len__(self) -> int:
        return len(self.tcp)

    def poses(self) -> Array:
        """Return ``T_world_tcp`` of each grasp, (K, 4, 4)."""
        sine, cosine = sincos(self.yaw)
        poses = np.zeros((len(self), 4, 4))
        poses[:, :3, :3] = downward(np.column_stack([cosine, sine]))
        poses[:, :3, 3], poses[:, 3, 3] = self.tcp, 1.0
        return poses

    def take(self, rows: NDArray[np.integer] | NDArray[np.bool_]) -> Candidates:
        """Return the grasps that indices or a mask select."""
        return Candidates(self.tcp[rows], self.yaw[rows], self.width[rows])

    def joined(self, others: Candidates) -> Candidates:
        """Return these grasps followed by the others."""
        return Candidates(
            np.concatenate([self.tcp, others.tcp]),
            np.concatenate([self.yaw, others.yaw]),
            np.concatenate([self.width, others.width]),
        )


def draw_open(region: Region, rng: np.random.Generator, count: int, aim: float) -> Candidates:
    """Return random grasps of the fully open gripper with uniform aim, yaw and depth.

    They have the distribution of the policy ``uniform``.

    Args:
        region: The region of possible grasps.
        rng: The random generator.
        count: The number of grasps.
        aim: Half the side of the square around the target's centre in which they aim, metres.
    """
    return Candidates(
        np.column_stack(
            [
                region.middle + rng.uniform(-aim, aim, size=(count, 2)),
                rng.uniform(*region.heights, size=count),
            ]
        ),
        rng.uniform(-np.pi / 2.0, np.pi / 2.0, size=count),
        np.full(count, region.gripper.max_width),
    )


def draw_fitted(
    region: Region, rng: np.random.Generator, count: int, *, aim: float, clearance: float,
    margin: float,
) -> Candidates:  # fmt: skip
    """Return random grasps centred on the part of the target between the pads, with uniform yaw.

    Height and width are chosen like those of the policy ``top_down``.

    Args:
        region: The region of possible grasps.
        rng: The random generator.
        count: The number of grasps.
        aim: Largest offset from the target's centre across the closing direction, metres.
        clearance: Added to half the pad's breadth on each side of the strip of points, metres.
        margin: Distance between each pad and the target if the gripper opens far enough, metres.
    """
    yaw = rng.uniform(-np.pi / 2.0, np.pi / 2.0, size=count)
    offset = rng.uniform(-aim, aim, size=count)
    sine, cosine = sincos(yaw)
    closing = np.column_stack([cosine, sine])
    across = np.column_stack([-closing[:, 1], closing[:, 0]])
    x, y = (region.points[:, :2] - region.middle).T
    u, v = (way[:, :1] * x + way[:, 1:] * y for way in (closing, across))  # (K, N)
    offset = np.clip(offset, v.min(axis=1), v.max(axis=1))
    half_strip = region.gripper.pad_size[0] / 2.0 + clearance
    inside = np.abs(v - offset[:, None]) < half_strip
    low = np.where(inside, u, np.inf).min(axis=1)
    high = np.where(inside, u, -np.inf).max(axis=1)
    empty = ~inside.any(axis=1)  # in the hole of a ring
    low[empty] = high[empty] = 0.0
    center = (low + high) / 2.0
    xy = region.middle + center[:, None] * closing + offset[:, None] * across
    z = np.full(count, grasp_height(region.heights[1], region.gripper))
    width = np.minimum(high - low + 2.0 * margin, region.gripper.max_width)
    return Candidates(np.column_stack([xy, z]), yaw, width)
