"""Views of boxes on the table for tests of policies; the checks of the package take them, too."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from grasp_factory.apps.conformance import box_views
from grasp_factory.apps.conformance.box_views import (
    BRICK,
    FRONT,
    RESOLUTION,
    PlacedBoxes,
    brick,
    entry_distance,
    lowest_corner,
    photograph,
    tilt_deg,
)
from grasp_factory.core.config.cameras import CameraConfig
from grasp_factory.core.episode import Grasp, SceneView
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies import POLICIES
from grasp_factory.robots import ROBOTS

__all__ = [
    "BRICK",
    "FRONT",
    "GRIPPER",
    "GRIPPERS",
    "RESOLUTION",
    "PlacedBoxes",
    "brick",
    "entry_distance",
    "lowest_corner",
    "make_view",
    "photograph",
    "plain",
    "plan",
    "tilt_deg",
]

GRIPPERS = {name: model.gripper for name, model in ROBOTS.items()}
GRIPPER = GRIPPERS["kuka_iiwa"]


def make_view(
    boxes: PlacedBoxes,
    gripper: Gripper = GRIPPER,
    cameras: Mapping[str, CameraConfig] = MappingProxyType({"front": FRONT}),
    resolution: tuple[int, int] = RESOLUTION,
) -> SceneView:
    return box_views.make_view(boxes, gripper, cameras, resolution)


def plain(grasps: tuple[Grasp, ...]) -> list[tuple[Any, ...]]:
    return [(grasp.T_world_tcp.tolist(), grasp.width, grasp.score) for grasp in grasps]


def plan(policy: str, view: SceneView, seed: int = 0, **settings: Any) -> tuple[Grasp, ...]:
    """Return what a policy of the table proposes."""
    asked = POLICIES[policy]
    return asked.plan(view, np.random.default_rng(seed), asked.settings(settings)).grasps
