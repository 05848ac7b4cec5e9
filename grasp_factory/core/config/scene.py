"""The config's sections on the scene: the workspace, and the number of objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Valid, Within, check_within
from grasp_factory.core.serialization import check
from grasp_factory.core.vectors import Vector3

MAX_OBJECTS = 10
"""Largest number of objects in an episode: more would be next to the hand before they fall."""


LOWER = "x >= 0.25 m: the robot stands at 0"
UPPER = "above lower by more than two margins"


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceConfig:
    """The box on the table in which objects are dropped and may be grasped (world frame)."""

    lower: Annotated[Vector3, Valid(LOWER)] = (0.42, -0.20, 0.0)
    """Lower corner, metres. The table top is z = 0; the robot's base is at the origin."""
    upper: Annotated[Vector3, Valid(UPPER)] = (0.68, 0.20, 0.30)
    """Upper corner, metres."""
    margin: Annotated[float, Within(0.0, 0.5, "m")] = 0.05
    """Smallest distance between a drop position and the sides of the box, metres."""
    drop_height: Annotated[tuple[float, float], Within(0.0, 1.0, "m")] = (0.02, 0.08)
    """Range of the distance from the table to the object's bounding box, metres."""

    def __post_init__(self) -> None:
        for i in range(3):
            ok = self.upper[i] - self.lower[i] > 2 * self.margin * (i < 2)
            check(ok, "upper", self.upper, UPPER)
        check(self.lower[0] >= 0.25, "lower", self.lower, LOWER)
        check_within(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClutterConfig:
    """The number of objects in a scene, and where they fall.

    The target is drawn first and dropped as if it were alone. The others fall around it, or onto
    it if there is no room next to it.
    """

    count: Annotated[int, Within(1, MAX_OBJECTS)] = 1
    """Number of objects, including the target."""
    radius: Annotated[float, Within(0.0, 0.3, "m")] = 0.15
    """Largest distance between the drop positions of the target and of another object, metres."""

    def __post_init__(self) -> None:
        check_within(self)
