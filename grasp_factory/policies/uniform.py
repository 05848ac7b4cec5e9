"""The policy ``uniform``: random downward grasps around the target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.serialization import check_range
from grasp_factory.policies.base import TIP_CLEARANCE, Policy, looking_down, target_points


@dataclass(frozen=True, slots=True, kw_only=True)
class UniformParameters:
    """Settings of ``uniform``."""

    aim_noise: float = 0.035
    """Half the side of the square around the target's centre in which the aim is drawn, metres."""

    def __post_init__(self) -> None:
        check_range(self, "aim_noise", 0.0, 0.5, "m")


def plan(view: SceneView, rng: np.random.Generator, settings: UniformParameters) -> GraspPlan:
    """Return one downward grasp with uniform aim, yaw and depth, and the gripper fully open.

    The TCP height is between the lowest at which the fingertips stay off the table and the target's
    highest visible point.
    """
    points = target_points(view)
    if not len(points):
        return GraspPlan(grasps=())
    lower, upper = points.min(axis=0), points.max(axis=0)
    noise = settings.aim_noise
    x, y = (lower[:2] + upper[:2]) / 2.0 + rng.uniform(-noise, noise, size=2)
    yaw = rng.uniform(-np.pi / 2.0, np.pi / 2.0)
    deepest = view.gripper.tip_distance + TIP_CLEARANCE
    z = rng.uniform(deepest, max(deepest, upper[2]))
    grasp = Grasp(T_world_tcp=looking_down(x, y, z, yaw), width=view.gripper.max_width)
    return GraspPlan(grasps=(grasp,))


UNIFORM = Policy(
    name="uniform",
    description="random aim, yaw and depth around the target, straight down",
    parameters=UniformParameters,
    plan=plan,
)
