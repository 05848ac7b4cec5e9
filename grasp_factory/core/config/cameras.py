"""Cameras by name. A new one is a row below; a config may describe others of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.core.config.sections import CameraConfig, Mount


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedCamera:
    """A place to look from."""

    name: str
    description: str
    config: CameraConfig


_FRONT = NamedCamera(
    name="front",
    description="stands across the table from the robot and looks down at the workspace",
    config=CameraConfig(eye=(1.15, 0.0, 0.58), target=(0.52, 0.0, 0.10), fov_y_deg=36.0),
)
_OVERHEAD = NamedCamera(
    name="overhead",
    description="hangs above the workspace and looks straight down; away from the robot is up",
    config=CameraConfig(
        eye=(0.55, 0.0, 1.10), target=(0.55, 0.0, 0.0), up=(1.0, 0.0, 0.0), fov_y_deg=36.0
    ),
)
_WRIST = NamedCamera(
    name="wrist",
    description="is fixed beside the hand, looks past the fingertips and moves with the hand",
    config=CameraConfig(
        eye=(0.075, 0.0, -0.12),
        target=(0.0, 0.0, 0.10),
        up=(-1.0, 0.0, 0.0),
        mount=Mount.TCP,
        fov_y_deg=60.0,
        near=0.03,
    ),
)

CAMERAS: Mapping[str, NamedCamera] = {camera.name: camera for camera in (_FRONT, _OVERHEAD, _WRIST)}
