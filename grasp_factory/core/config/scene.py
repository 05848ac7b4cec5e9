"""Where objects are dropped, and how many."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check, check_range
from grasp_factory.core.vectors import Vector3

MAX_OBJECTS = 10
"""Objects of an episode: more would hang beside the hand before they fall."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkspaceConfig:
    """The box on the table in which objects are dropped and may be grasped (world frame)."""

    lower: Vector3 = (0.42, -0.20, 0.0)
    """Metres. The table top is z = 0; the robot's base stands at the origin."""
    upper: Vector3 = (0.68, 0.20, 0.30)
    margin: float = 0.05
    """Metres inside the box's sides within which drop positions are drawn."""
    drop_height: tuple[float, float] = (0.02, 0.08)
    """Metres between the table and the lowest corner of the object's bounding box."""

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
    """How many objects fall together.

    The target is the one drawn first, let go as if it were alone; the others fall around it, or
    onto it where there is no room beside it.
    """

    count: int = 1
    """Objects, the target among them."""
    radius: float = 0.15
    """Metres around the target's place within which the others fall."""

    def __post_init__(self) -> None:
        check_range(self, "count", 1, MAX_OBJECTS)
        check_range(self, "radius", 0.0, 0.3, "m")
