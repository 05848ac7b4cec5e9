"""The policy ``top_down``: downward grasps across narrow parts of the target in depth images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.elementary import sincos
from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.geometry import Array, apply, inverse, transform
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.serialization import check_range
from grasp_factory.policies.base import (
    TIP_CLEARANCE,
    Policy,
    downward,
    target_points,
    visible_points,
)
from grasp_factory.policies.clearance import is_hit, open_gripper

YAWS = 24
"""Number of closing directions that are tried, 7.5 degrees apart over half a turn."""
DIRECTIONS = np.column_stack(sincos(np.arange(YAWS) * np.pi / YAWS)[::-1])
"""The closing directions as horizontal unit vectors: x and y in the world frame, (24, 2)."""
OFFSETS = (-0.02, -0.01, 0.0, 0.01, 0.02)
"""Offsets of grasps from the target's centre, across the closing direction, metres."""
RANKED = 8
"""Largest number of proposed grasps, the best first."""
THINNING = 7
"""Only every n-th visible point of other objects is checked; points are about 1 mm apart."""
CLEARANCE = 0.003
"""Smallest distance between the gripper and points of other objects, metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopDownParameters:
    """Settings of ``top_down``."""

    finger_clearance: float = 0.008
    """Smallest distance between each pad and the target on the approach, metres."""
    opening_margin: float = 0.015
    """The same where the gripper can open far enough, metres."""

    def __post_init__(self) -> None:
        check_range(self, "finger_clearance", 0.0, 0.05, "m")
        check_range(self, "opening_margin", 0.0, 0.05, "m")


def plan(view: SceneView, rng: np.random.Generator, settings: TopDownParameters) -> GraspPlan:
    """Return downward grasps; those with a small span near the target's centre are first.

    Grasps at which the gripper would touch a visible point of another object are last.

    The target's visible points are divided into strips as wide as a finger. The gripper must span
    the extent of a strip along the closing direction.
    """
    del rng  # the same view gives the same plan
    points = target_points(view)
    if not len(points):
        return GraspPlan(grasps=())
    z = grasp_height(float(points[:, 2].max()), view.gripper)
    middle = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2.0
    outline = _Outline(points[:, :2] - middle, middle, z, view.gripper, settings)
    grasps = [grasp for direction in DIRECTIONS for grasp in outline.along(direction)]
    neighbors = visible_points(view, lambda labels: labels > view.target_label)[::THINNING]
    grasps.sort(key=lambda grasp: (_meets(grasp, view.gripper, neighbors), -grasp.score))
    return GraspPlan(grasps=tuple(grasps[:RANKED]))


def _meets(grasp: Grasp, gripper: Gripper, points: Array) -> bool:
    """Return whether the open gripper would touch any of the points (N, 3), world frame."""
    if not len(points):
        return False
    at_tcp = apply(inverse(grasp.T_world_tcp), points)
    return is_hit(open_gripper(gripper, grasp.width), at_tcp, CLEARANCE)


def grasp_height(top: float, gripper: Gripper) -> float:
    """Return the TCP height for a target whose highest point is at ``top``, metres.

    It is half of ``top``, or higher if the fingertips would touch the table or if the palm would
    touch the target.
    """
    deepest = gripper.tip_distance + TIP_CLEARANCE
    under_palm = top - gripper.palm_distance + TIP_CLEARANCE
    return max(deepest, under_palm, top / 2.0)


@dataclass(frozen=True, slots=True)
class _Outline:
    """The target's visible points projected onto the table, and the gripper."""

    points: Array
    """(K, 2) metres, x and y relative to ``middle``."""
    middle: Array
    """(2,) metres, world frame: x and y of the target's centre."""
    z: float
    """Height of the TCP, metres."""
    gripper: Gripper
    settings: TopDownParameters

    def along(self, closing: Array) -> list[Grasp]:
        """Return the grasps that close along one horizontal direction, (2,)."""
        cosine, sine = closing
        across = np.array([-sine, cosine])
        x, y = self.points[:, 0], self.points[:, 1]
        u, v = cosine * x + sine * y, cosine * y - sine * x
        R = downward(closing)
        half_strip = self.gripper.pad_size[0] / 2.0 + self.settings.finger_clearance
        grasps = []
        for offset in OFFSETS:
            strip = u[np.abs(v - offset) < half_strip]
            if not len(strip):
                continue
            low, high = float(strip.min()), float(strip.max())
            center, span = (low + high) / 2.0, high - low
            x, y = self.middle + center * closing + offset * across
            # A grasp that does not fit is still proposed, with a low score: an empty plan is worse.
            needed = span + 2.0 * self.settings.finger_clearance
            overshoot = max(0.0, needed - self.gripper.max_width)
            grasps.append(
                Grasp(
                    T_world_tcp=transform(R, (x, y, self.z)),
                    width=min(span + 2.0 * self.settings.opening_margin, self.gripper.max_width),
                    score=-span - abs(center) - abs(offset) - 10.0 * overshoot,
                )
            )
        return grasps


TOP_DOWN = Policy(
    name="top_down",
    description="straight down across a narrow place near the target's middle",
    parameters=TopDownParameters,
    plan=plan,
)
