"""The dimensions and limits of a parallel gripper that a policy needs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripper:
    """A parallel gripper, described in its TCP frame: +z approaches, +y closes."""

    max_width: float
    """Distance between the pads when the gripper is fully open, metres."""
    tip_distance: float
    """Distance from the TCP to the ends of the fingertips, along +z, metres."""
    palm_distance: float
    """Distance from the palm to the TCP, along +z, metres."""
    pad_size: tuple[float, float]
    """Width (along x) and height (along z) of a pad, metres."""
    finger_thickness: float
    """Extent of a finger along y, metres."""
    force_range: tuple[float, float]
    """Smallest and largest gripping force of the datasheet, N."""
    max_finger_speed: float
    """Maximum speed of each finger, m/s."""
