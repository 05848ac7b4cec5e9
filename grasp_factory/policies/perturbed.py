"""The policy ``perturbed``: another policy's grasps with noise on their poses.

Many of these grasps fail although they are close to grasps that hold (hard negatives).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from grasp_factory.core.elementary import normal
from grasp_factory.core.episode import Grasp, GraspPlan, SceneView
from grasp_factory.core.geometry import rotation_about
from grasp_factory.core.gripper import Gripper
from grasp_factory.core.linear import length, product
from grasp_factory.core.serialization import check, check_range, to_plain
from grasp_factory.policies.base import Policy, inner_settings
from grasp_factory.policies.clearance import off_the_table
from grasp_factory.policies.direct import DIRECT


@dataclass(frozen=True, slots=True, kw_only=True)
class PerturbedParameters:
    """Settings of ``perturbed``."""

    base: str = "top_down"
    """The policy whose grasps are perturbed."""
    base_parameters: Mapping[str, Any] = field(default_factory=dict)
    """Its settings; missing keys take their defaults."""
    position_sigma: float = 0.01
    """Standard deviation of the TCP's position along each axis, metres."""
    rotation_sigma_deg: float = 10.0
    """Standard deviation of the rotation vector's components, degrees."""

    def __post_init__(self) -> None:
        check(self.base in DIRECT, "base", self.base, ", ".join(DIRECT))
        check_range(self, "position_sigma", 0.0, 0.2, "m")
        check_range(self, "rotation_sigma_deg", 0.0, 60.0, "degrees")
        # A recipe contains every setting, also those of the base policy.
        inner = inner_settings(DIRECT[self.base], self.base_parameters, "base_parameters")
        object.__setattr__(self, "base_parameters", to_plain(inner))


def plan(view: SceneView, rng: np.random.Generator, settings: PerturbedParameters) -> GraspPlan:
    """Return the base policy's grasps, with its order and scores; each has independent noise."""
    base = DIRECT[settings.base]
    planned = base.plan(view, rng, base.settings(settings.base_parameters))
    return GraspPlan(
        grasps=tuple(
            dataclasses.replace(
                perturb(grasp, view.gripper, rng, settings), proposer=grasp.proposer or base.name
            )
            for grasp in planned.grasps
        )
    )


def perturb(
    grasp: Grasp, gripper: Gripper, rng: np.random.Generator, settings: PerturbedParameters
) -> Grasp:
    """Return the grasp, randomly moved and rotated; its fingertips stay off the table."""
    T = grasp.T_world_tcp.copy()
    T[:3, 3] += settings.position_sigma * normal(rng, 3)
    turn = math.radians(settings.rotation_sigma_deg) * normal(rng, 3)
    angle = length(turn)
    if angle > 0.0:
        T[:3, :3] = product(T[:3, :3], rotation_about(turn / angle, angle))
    T[2, 3] += off_the_table(T, gripper, grasp.width)
    return dataclasses.replace(grasp, T_world_tcp=T)


PERTURBED = Policy(
    name="perturbed",
    description="another policy's grasps with noise on their poses: hard negatives",
    parameters=PerturbedParameters,
    plan=plan,
)
