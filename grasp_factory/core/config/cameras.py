"""The settings of a camera, and the table of predefined cameras.

A new predefined camera is a row of the table; a config may also define its own cameras.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated

from grasp_factory.core.config.within import Valid, Within, check_within
from grasp_factory.core.serialization import check
from grasp_factory.core.vectors import Vector3

PLACE = "within 100 m of the origin"
UP = "not parallel to target - eye"


class Mount(Enum):
    """What a camera is fixed to: its pose is expressed in the frame of this."""

    WORLD = "world"
    TCP = "tcp"
    """The tool centre point of the hand: the camera moves with the hand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """A camera at ``eye`` that looks at ``target`` (metres, in the frame of its mount)."""

    eye: Annotated[Vector3, Valid(PLACE)]
    """Where the camera is, metres, in the frame of its mount."""
    target: Annotated[Vector3, Valid(PLACE)]
    """The point that it looks at, metres, in the same frame."""
    up: Annotated[Vector3, Valid(UP)] = (0.0, 0.0, 1.0)
    """The direction that is up in the image, in the same frame."""
    mount: Mount = Mount.WORLD
    """What it is fixed to."""
    fov_y_deg: Annotated[float, Within(1.0, 170.0, "degrees")] = 45.0
    """Vertical field of view, degrees."""
    near: Annotated[float, Within(0.001, 10.0, "m")] = 0.1
    """Near end of the clipping range, metres; a narrow range makes the z-buffer more precise."""
    far: Annotated[float, Within(0.01, 100.0, "m")] = 4.0
    """Far end of the clipping range, metres."""

    def __post_init__(self) -> None:
        check_within(self)
        check(self.near < self.far, "near", self.near, f"less than far ({self.far})")
        for key in ("eye", "target"):
            near = all(abs(x) <= 100.0 for x in getattr(self, key))
            check(near, key, getattr(self, key), PLACE)
        view = [t - e for t, e in zip(self.target, self.eye, strict=True)]
        cross = [
            view[1] * self.up[2] - view[2] * self.up[1],
            view[2] * self.up[0] - view[0] * self.up[2],
            view[0] * self.up[1] - view[1] * self.up[0],
        ]
        check(sum(v * v for v in cross) > 1e-12, "up", self.up, UP)


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedCamera:
    """A predefined camera."""

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
