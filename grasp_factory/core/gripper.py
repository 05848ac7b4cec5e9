"""The shape of a parallel gripper, as far as a policy needs to know it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripper:
    """A parallel gripper, described in its TCP frame: +z approaches, +y closes."""

    max_width: float
    """Metres between the fully open pads."""
    tip_distance: float
    """Metres from the TCP to the fingertips' ends, along +z."""
    palm_distance: float
    """Metres from the palm to the TCP, along +z."""
    pad_size: tuple[float, float]
    """Width (along x) and height (along z) of a pad, metres."""
    finger_thickness: float
    """Extent of a finger along y, metres."""
    force_range: tuple[float, float]
    """Smallest and largest gripping force of the datasheet, N."""
    max_finger_speed: float
    """Metres per second, of each finger."""
