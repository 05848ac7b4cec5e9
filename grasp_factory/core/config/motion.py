"""The config's section on motion: distances, speeds, grip force, and bounds for durations."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Within, check_within

MAX_TRANSFER_S = 2.5
"""Grasps with a longer transfer from home count as unreachable; this bounds every attempt."""
SHORTEST_MOTION_S = 0.15
"""Shortest duration of a motion, so that the arm does not jerk."""
PEAK_OVER_MEAN = 1.875
"""Ratio of peak to mean speed of a minimum-jerk motion (Flash & Hogan 1985): 15/8."""
MAX_STRETCH = 2.0
"""Slow joints may make a straight motion this many times longer than its speed requires."""
MAX_CLOSING_STROKE = 0.06
"""Metres: upper bound for the travel of a finger (``tests/robots/test_closing_time.py``)."""
SLOWEST_FINGERS = 0.05
"""m/s: lower bound for the maximum finger speed of a robot; the same test checks it."""
STALLED_S = 0.1
"""Seconds for which the closed fingers must be at rest before the lift begins."""
CLOSING_SETTLE_S = 0.3
"""Seconds added to the travel time of the fingers, in which they come to rest for so long."""


def straight_motion_s(distance: float, peak_speed: float) -> float:
    """Return the seconds of a minimum-jerk motion over a distance (m) with a peak speed (m/s)."""
    return max(PEAK_OVER_MEAN * distance / peak_speed, SHORTEST_MOTION_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """Distances, speeds and grip force of an attempt."""

    pregrasp_distance: Annotated[float, Within(0.02, 0.3, "m")] = 0.10
    """Distance from the pregrasp to the grasp along the approach axis, metres."""
    approach_speed: Annotated[float, Within(0.01, 2.0, "m/s")] = 0.25
    """Peak TCP speed on the straight approach, m/s."""
    lift_height: Annotated[float, Within(0.02, 0.5, "m")] = 0.20
    """Height of the lift, straight up, metres."""
    lift_speed: Annotated[float, Within(0.01, 2.0, "m/s")] = 0.60
    """Peak TCP speed of the lift, m/s."""
    closing_speed: Annotated[float, Within(0.01, 2.0, "m/s")] = 0.10
    """Speed of each finger, m/s; limited to the gripper's maximum speed."""
    grip_force: Annotated[float, Within(0.1, 200.0, "N")] = 20.0
    """Force limit of each finger, N."""
    hold_s: Annotated[float, Within(0.1, 3.0, "s")] = 0.3
    """Seconds the object must stay in the hand after the lift."""
    speed_scale: Annotated[float, Within(0.05, 1.0)] = 0.9
    """Fraction of the robot's joint velocity limits that planned motion may use."""

    def __post_init__(self) -> None:
        check_within(self)

    def scaled(self, force: float, speed: float) -> MotionConfig:
        """Return the motion with its force and its speeds multiplied by factors.

        Raises:
            ConfigError: naming the value that is out of its range.
        """
        speeds = ("approach_speed", "closing_speed", "lift_speed")
        changed = {key: speed * getattr(self, key) for key in speeds}
        return dataclasses.replace(self, grip_force=force * self.grip_force, **changed)

    @property
    def longest_close_s(self) -> float:
        """Upper bound for the duration of the closing, seconds."""
        speed = min(self.closing_speed, SLOWEST_FINGERS)
        return MAX_CLOSING_STROKE / speed + CLOSING_SETTLE_S

    @property
    def approach_s(self) -> float:
        """Duration of the approach, seconds, unless a joint is too slow for it."""
        return straight_motion_s(self.pregrasp_distance, self.approach_speed)

    @property
    def lift_s(self) -> float:
        """Duration of the lift, seconds, unless a joint is too slow for it."""
        return straight_motion_s(self.lift_height, self.lift_speed)

    @property
    def longest_s(self) -> float:
        """Upper bound for the time from home to the end of the hold, seconds."""
        straight = MAX_STRETCH * (self.approach_s + self.lift_s)
        return MAX_TRANSFER_S + straight + self.longest_close_s + self.hold_s
