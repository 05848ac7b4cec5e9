"""The unit in which people see a quantity: one for each, in pictures, plots and pages.

Stores, conditions and exports have SI units; only what is shown is converted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ShownUnit:
    """A unit, and how a stored value becomes a number in it."""

    unit: str
    factor: float
    """Of this unit in one of the stored unit."""
    decimals: int
    """That a text has."""

    def text(self, stored: float) -> str:
        """Return a stored value in words, such as ``12.3 mm``."""
        space = "" if self.unit == "°" else " "
        return f"{self.factor * stored:.{self.decimals}f}{space}{self.unit}"


MILLIMETRES = ShownUnit("mm", 1e3, 1)
SHOWN_UNITS: Mapping[str, ShownUnit] = {
    "lift_height": MILLIMETRES,
    "slip_distance": MILLIMETRES,
    "slip_angle": ShownUnit("°", 180.0 / math.pi, 1),
    "grasp_width": MILLIMETRES,
    "rest_height": MILLIMETRES,
    "gripper_width": MILLIMETRES,
    "object_height": MILLIMETRES,
    "max_penetration": ShownUnit("mm", 1e3, 2),
    "table_penetration": ShownUnit("mm", 1e3, 2),
    "contact_area": ShownUnit("mm²", 1e6, 2),
    "object_mass": ShownUnit("g", 1e3, 0),
    "min_grip_force": ShownUnit("N", 1.0, 1),
    "hold_duration": ShownUnit("s", 1.0, 2),
    "shake_level": ShownUnit("g", 1.0, 2),
    "loss_time": ShownUnit("s", 1.0, 2),
}
"""By the names of columns and of groups of curves; all others are shown as they are stored."""
