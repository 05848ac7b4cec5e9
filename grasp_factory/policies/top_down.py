"""Downward grasps across narrow places of the target that the depth image shows."""

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
"""Closing directions that are tried, 7.5 degrees apart over half a turn."""
DIRECTIONS = np.column_stack(sincos(np.arange(YAWS) * np.pi / YAWS)[::-1])
"""They as unit vectors seen from above, (24, 2)."""
OFFSETS = (-0.02, -0.01, 0.0, 0.01, 0.02)
"""Metres from the target's middle, across the closing direction, at which it may be grasped."""
RANKED = 8
"""Grasps that are proposed, the best first."""
THINNING = 7
"""One in so many visible points of other objects is checked; points are about 1 mm apart."""
CLEARANCE = 0.003
"""Metres that the gripper shall keep from them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TopDownParameters:
    """Settings of ``top_down``."""

    finger_clearance: float = 0.008
    """Metres that each pad stays clear of the target on the approach, at the least."""
    opening_margin: float = 0.015
    """Metres that each pad stays clear of it where the gripper opens far enough."""

    def __post_init__(self) -> None:
        check_range(self, "finger_clearance", 0.0, 0.05, "m")
        check_range(self, "opening_margin", 0.0, 0.05, "m")


def plan(view: SceneView, rng: np.random.Generator, settings: TopDownParameters) -> GraspPlan:
    """Return downward grasps, those first that span little and lie near the target's middle.

    Grasps at which the gripper would touch a visible point of another object come last.

    The target's visible points are cut into strips as wide as a finger; a strip's extent along
    the closing direction is what the gripper must span there.
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
    """Return whether the open gripper would be where the points (N, 3), world, are."""
    if not len(points):
        return False
    at_tcp = apply(inverse(grasp.T_world_tcp), points)
    return is_hit(open_gripper(gripper, grasp.width), at_tcp, CLEARANCE)


def grasp_height(top: float, gripper: Gripper) -> float:
    """Return the TCP height for a target whose highest point is at ``top``, metres.

    Half way up the target, as far as the fingertips stay off the table and the palm off the top.
    """
    deepest = gripper.tip_distance + TIP_CLEARANCE
    under_palm = top - gripper.palm_distance + TIP_CLEARANCE
    return max(deepest, under_palm, top / 2.0)


@dataclass(frozen=True, slots=True)
class _Outline:
    """What is seen of the target from above, and the gripper that shall go around it."""

    points: Array
    """(K, 2) metres from ``middle``."""
    middle: Array
    """(2,) metres, world."""
    z: float
    gripper: Gripper
    settings: TopDownParameters

    def along(self, closing: Array) -> list[Grasp]:
        """Return the grasps that close along one direction, (2,)."""
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
            # What does not fit is still proposed, last: a crowded plan beats none.
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
