"""The config's sections on the scene: the workspace, and the number of objects."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check, check_range
from grasp_factory.core.vectors import Vector3

MAX_OBJECTS = 10
"""Largest number of objects in an episode: more would be next to the hand before they fall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceConfig:
    """The box on the table in which objects are dropped and may be grasped (world frame)."""

    lower: Vector3 = (0.42, -0.20, 0.0)
    """Metres. The table top is z = 0; the robot's base is at the origin."""
    upper: Vector3 = (0.68, 0.20, 0.30)
    """Metres."""
    margin: float = 0.05
    """Smallest distance between a drop position and the sides of the box, metres."""
    drop_height: tuple[float, float] = (0.02, 0.08)
    """Range of the distance from the table to the object's bounding box, metres."""

    def __post_init__(self) -> None:
        for i in range(3):
            ok = self.upper[i] - self.lower[i] > 2 * self.margin * (i < 2)
            check(ok, "upper", self.upper, "above lower by more than two margins")
        check_range(self, "margin", 0.0, 0.5, "m")
        check(self.lower[0] >= 0.25, "lower", self.lower, "x >= 0.25 m: the robot stands at 0")
        low, high = self.drop_height
        check(0.0 <= low <= high <= 1.0, "drop_height", self.drop_height, "0 <= low <= high <= 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class ClutterConfig:
    """The number of objects in a scene, and where they fall.

    The target is drawn first and dropped as if it were alone. The others fall around it, or onto
    it if there is no room next to it.
    """

    count: int = 1
    """Number of objects, including the target."""
    radius: float = 0.15
    """Largest distance between the drop positions of the target and of another object, metres."""

    def __post_init__(self) -> None:
        check_range(self, "count", 1, MAX_OBJECTS)
        check_range(self, "radius", 0.0, 0.3, "m")
