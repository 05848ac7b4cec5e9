"""Sections of a config: cameras, workspace, motion, shake, label; others have their own modules."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from enum import Enum
from typing import Any

from grasp_factory.core.serialization import check, check_range
from grasp_factory.core.vectors import Vector3

MAX_TRANSFER_S = 2.5
"""Grasps that need a longer way from home count as unreachable: it bounds every attempt."""
SHORTEST_MOTION_S = 0.15
"""Even the shortest motion takes this long, so that the arm does not jerk."""
PEAK_OVER_MEAN = 1.875
"""Peak over mean speed of a minimum-jerk motion (Flash & Hogan 1985): 15/8."""
MAX_STRETCH = 2.0
"""A straight motion may take this many times longer than its speed says, for slow joints."""
MAX_CLOSING_STROKE = 0.06
"""Metres: bound for the travel of a finger; ``tests/robots/test_closing_time.py`` checks robots."""
SLOWEST_FINGERS = 0.05
"""m/s: bound for the greatest speed of fingers; the same test checks it."""
STANDARD_GRAVITY = 9.80665
"""m/s2: the g of shake levels and of datasheets (ISO 80000-3)."""
STRONGEST_SHAKE = 3.0
"""Level beyond which the arm would not follow."""
SHORTEST_CYCLE = 4
"""Control periods that a motion of the shake takes at the least."""
SHAKE_MOTIONS = 4
"""Motions of each level of the shake: along three axes and about one."""
MAX_OBJECTS = 10
"""Objects of an episode: more would hang beside the hand before they fall."""
CLOSING_SETTLE_S = 0.3
"""Seconds that the fingers may take beyond their travel until they stand still."""


def straight_motion_s(distance: float, peak_speed: float) -> float:
    """Return the seconds of a minimum-jerk motion over a distance (m) with a peak speed (m/s)."""
    return max(PEAK_OVER_MEAN * distance / peak_speed, SHORTEST_MOTION_S)


class Mount(Enum):
    """What a camera is fixed to, and so the frame that its pose is given in."""

    WORLD = "world"
    TCP = "tcp"
    """The hand: the camera moves with it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """A camera, looking from ``eye`` to ``target`` (metres, in the frame of its mount)."""

    eye: Vector3
    target: Vector3
    up: Vector3 = (0.0, 0.0, 1.0)
    mount: Mount = Mount.WORLD
    """What it is fixed to."""
    fov_y_deg: float = 45.0
    """Vertical field of view, degrees."""
    near: float = 0.1
    """Clipping range in metres: a tight one keeps the z-buffer's resolution."""
    far: float = 4.0

    def __post_init__(self) -> None:
        check_range(self, "fov_y_deg", 1.0, 170.0, "degrees")
        check_range(self, "near", 0.001, 10.0, "m")
        check_range(self, "far", 0.01, 100.0, "m")
        check(self.near < self.far, "near", self.near, f"less than far ({self.far})")
        for key in ("eye", "target"):
            near = all(abs(x) <= 100.0 for x in getattr(self, key))
            check(near, key, getattr(self, key), "within 100 m of the origin")
        view = [t - e for t, e in zip(self.target, self.eye, strict=True)]
        cross = [
            view[1] * self.up[2] - view[2] * self.up[1],
            view[2] * self.up[0] - view[0] * self.up[2],
            view[0] * self.up[1] - view[1] * self.up[0],
        ]
        check(sum(v * v for v in cross) > 1e-12, "up", self.up, "not parallel to target - eye")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionConfig:
    """How an attempt is executed."""

    pregrasp_distance: float = 0.10
    """Metres from the grasp, back along the approach axis."""
    approach_speed: float = 0.25
    """Peak TCP speed on the straight approach, m/s."""
    lift_height: float = 0.20
    """Metres, straight up."""
    lift_speed: float = 0.60
    """Peak TCP speed of the lift, m/s."""
    closing_speed: float = 0.10
    """Speed of each finger, m/s; the gripper's own greatest speed where that is less."""
    grip_force: float = 20.0
    """Force limit of each finger, N."""
    hold_s: float = 0.3
    """Seconds the object must stay in the hand after the lift."""
    speed_scale: float = 0.9
    """Fraction of the robot's joint velocity limits that planned motion may use."""

    def __post_init__(self) -> None:
        check_range(self, "pregrasp_distance", 0.02, 0.3, "m")
        check_range(self, "approach_speed", 0.01, 2.0, "m/s")
        check_range(self, "lift_height", 0.02, 0.5, "m")
        check_range(self, "lift_speed", 0.01, 2.0, "m/s")
        check_range(self, "closing_speed", 0.01, 2.0, "m/s")
        check_range(self, "grip_force", 0.1, 200.0, "N")
        check_range(self, "hold_s", 0.1, 3.0, "s")
        check_range(self, "speed_scale", 0.05, 1.0)

    def scaled(self, force: float, speed: float) -> MotionConfig:
        """Return the motion with factors on its force and on its speeds.

        Raises:
            ConfigError: naming the value that is out of its range.
        """
        speeds = ("approach_speed", "closing_speed", "lift_speed")
        changed = {key: speed * getattr(self, key) for key in speeds}
        return dataclasses.replace(self, grip_force=force * self.grip_force, **changed)

    @property
    def longest_close_s(self) -> float:
        """Upper bound for the time of the closing, seconds."""
        speed = min(self.closing_speed, SLOWEST_FINGERS)
        return MAX_CLOSING_STROKE / speed + CLOSING_SETTLE_S

    @property
    def approach_s(self) -> float:
        """Seconds that the approach takes, unless a joint is too slow for it."""
        return straight_motion_s(self.pregrasp_distance, self.approach_speed)

    @property
    def lift_s(self) -> float:
        """Seconds that the lift takes, unless a joint is too slow for it."""
        return straight_motion_s(self.lift_height, self.lift_speed)

    @property
    def longest_s(self) -> float:
        """Upper bound for the time from home to the end of the hold, seconds."""
        straight = MAX_STRETCH * (self.approach_s + self.lift_s)
        return MAX_TRANSFER_S + straight + self.longest_close_s + self.hold_s


@dataclass(frozen=True, slots=True, kw_only=True)
class ShakeConfig:
    """The disturbance after the hold.

    At each level the hand goes once to and fro along the world's three axes, then turns to and
    fro about its approach axis.
    """

    levels: tuple[float, ...] = (0.5, 1.0)
    """Peak accelerations in units of standard gravity, increasing; none for no shake.

    The arm follows to 2 % up to level 2 and no longer at 5 (IMU peaks down to 4.4).
    """
    cycle_s: float = 0.12
    """Seconds of one motion to and fro; it is shorter where a joint would be too slow."""
    lever: float = 0.10
    """Metres from the approach axis at which the turn's acceleration is that of the level."""

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in itertools.pairwise((0.0, *self.levels)))
        check(rising, "levels", list(self.levels), "increasing numbers above 0")
        check(len(self.levels) <= 10, "levels", list(self.levels), "at most 10 levels")
        strongest = max(self.levels, default=0.0)
        check(strongest <= STRONGEST_SHAKE, "levels", list(self.levels), f"up to {STRONGEST_SHAKE}")
        check_range(self, "cycle_s", 0.05, 1.0, "s")
        check_range(self, "lever", 0.01, 1.0, "m")

    def longest_s(self, control_hz: int) -> float:
        """Return an upper bound for the time of all levels, seconds."""
        cycle = max(self.cycle_s, SHORTEST_CYCLE / control_hz)
        return len(self.levels) * SHAKE_MOTIONS * cycle


def _condition(text: str, default: float | None) -> Any:
    """Return a threshold's field; ``text`` says what it asks for, {} stands for its value."""
    return dataclasses.field(default=default, metadata={"condition": text})


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelConfig:
    """The thresholds behind the success label; a minimum of 0, or None, asks for nothing."""

    min_lift: float = _condition(
        "its centre of mass is at least {} m above its rest at the end of the hold", 0.10
    )
    min_shake: float = _condition("it survives the shake up to level {}", 1.0)
    min_grip_force: float = _condition(
        "neither pad presses with less than {} N during the hold", 0.0
    )
    max_slip_distance: float | None = _condition(
        "its centre of mass moves at most {} m in the hand", None
    )
    max_slip_angle: float | None = _condition("it turns at most {} rad in the hand", None)

    def __post_init__(self) -> None:
        check_range(self, "min_lift", 0.01, 0.5, "m")
        check_range(self, "min_shake", 0.0, 100.0)
        check_range(self, "min_grip_force", 0.0, 1000.0, "N")
        for key in ("max_slip_distance", "max_slip_angle"):
            if getattr(self, key) is not None:
                check_range(self, key, 0.0, 100.0)

    def conditions(self) -> dict[str, str]:
        """Return in words what success asks for, by threshold, without those that ask nothing."""
        values = {name: getattr(self, name) for name in self.condition_texts()}
        return {
            name: text.format(f"{values[name]:g}")
            for name, text in self.condition_texts().items()
            if values[name] is not None and not (name.startswith("min_") and values[name] == 0.0)
        }

    @classmethod
    def condition_texts(cls) -> dict[str, str]:
        """Return what each threshold asks for in words, with {} where its value stands."""
        return {field.name: field.metadata["condition"] for field in dataclasses.fields(cls)}
