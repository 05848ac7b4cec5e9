"""Start poses of the objects: the target in the air above the workspace, the others around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.elementary import normal, sincos
from grasp_factory.core.geometry import Array, Pose, quat_xyzw_to_matrix
from grasp_factory.core.linear import norm, turned

GAP = 0.01
"""Smallest distance between the bounding boxes of objects that are dropped together, metres."""
TRIES = 32
"""Number of positions drawn for each further object; the lowest is used, to keep heaps low."""


@dataclass(frozen=True, slots=True)
class Placed:
    """An object before its fall: its pose, and its bounding box in that pose."""

    pose: Pose
    lower: Array
    """(3,) world, metres."""
    upper: Array

    def raised_above(self, others: Sequence[Placed]) -> Placed:
        """Return this object, raised until it is above all others that it overlaps in x and y."""
        below = [o for o in others if self._covers(o)]
        floor = max((float(o.upper[2]) + GAP for o in below), default=float(self.lower[2]))
        rise = np.array([0.0, 0.0, max(0.0, floor - float(self.lower[2]))])
        x, y, z = (float(v) for v in np.array(self.pose.position) + rise)
        return Placed(Pose((x, y, z), self.pose.quat_xyzw), self.lower + rise, self.upper + rise)

    def _covers(self, other: Placed) -> bool:
        apart = (self.lower > other.upper + GAP) | (self.upper < other.lower - GAP)
        return not bool(apart[:2].any())


def place_target(workspace: WorkspaceConfig, corners: Array, rng: np.random.Generator) -> Placed:
    """Draw a pose with uniform orientation, with the bounding box in the air above the table.

    Args:
        workspace: The target is dropped above it, inside its margin.
        corners: Corners of the object's bounding box, (8, 3) metres, object frame.
        rng: Random generator.
    """
    quat = _draw_quat(rng)
    lower = np.array(workspace.lower[:2]) + workspace.margin
    upper = np.array(workspace.upper[:2]) - workspace.margin
    return _hang(corners, quat, rng.uniform(lower, upper), rng.uniform(*workspace.drop_height))


def place_around(
    target: Placed,
    workspace: WorkspaceConfig,
    radius: float,
    others: Sequence[Array],
    rng: np.random.Generator,
) -> list[Placed]:
    """Return poses for all objects, the target first, so that no two objects touch.

    The target keeps its pose. The centres of the others are within ``radius`` metres of the
    target in x and y, and inside the workspace's margin. Each object is next to the objects placed
    before it, or above them.

    Args:
        target: The result of ``place_target``.
        workspace: As for ``place_target``.
        radius: Largest distance of the others from the target, metres.
        others: Corners (8, 3) of each other object's bounding box, object frame, metres.
        rng: Random generator.
    """
    middle = (target.lower[:2] + target.upper[:2]) / 2.0
    low = np.array(workspace.lower[:2]) + workspace.margin
    high = np.array(workspace.upper[:2]) - workspace.margin
    placed = [target]
    for corners in others:
        quat, height = _draw_quat(rng), rng.uniform(*workspace.drop_height)
        angles = rng.uniform(0.0, 2.0 * np.pi, TRIES)
        ways = radius * np.sqrt(rng.uniform(0.0, 1.0, TRIES))
        sines, cosines = sincos(angles)
        spots = middle + ways[:, None] * np.column_stack([cosines, sines])
        hung = [
            _hang(corners, quat, spot, height).raised_above(placed)
            for spot in np.clip(spots, low, high)
        ]
        placed.append(min(hung, key=lambda option: float(option.lower[2])))
    return placed


def _hang(corners: Array, quat: Array, middle: Array, height: float) -> Placed:
    """Return an object with its bounding box ``height`` above the table, centred at ``middle``."""
    around = turned(quat_xyzw_to_matrix(quat), corners)
    low, high = around.min(axis=0), around.max(axis=0)
    x, y = middle - (low[:2] + high[:2]) / 2.0
    position = np.array([x, y, height - low[2]])
    qx, qy, qz, qw = (float(q) for q in quat)
    pose = Pose((float(x), float(y), float(position[2])), (qx, qy, qz, qw))
    return Placed(pose, low + position, high + position)


def _draw_quat(rng: np.random.Generator) -> Array:
    quat = normal(rng, 4)
    return np.asarray(quat / norm(quat))
