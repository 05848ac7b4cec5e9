"""Messages of sensors as rows of CSV files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from grasp_factory.core.text_format import escaped


@dataclass(frozen=True, slots=True)
class Seconds:
    """A stamp as a cell: a number in seconds with all of its nine decimal places."""

    ns: int

    def __str__(self) -> str:
        whole, part = divmod(abs(self.ns), 10**9)
        return f"{'-' if self.ns < 0 else ''}{whole}.{part:09d}"


Cell = float | str | Seconds | None
_XYZ = ("x", "y", "z")
_XYZW = (*_XYZ, "w")
_QUAT = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesKind:
    """A kind of time series: which folder it goes to, and its rows."""

    name: str
    """Name of its folder."""
    columns: tuple[str, ...]
    rows: Callable[[Any], list[list[Cell]]]
    """Returns the rows of a message without its time."""


def _number(value: float) -> float | None:
    """Return a cell that is empty for NaN."""
    return None if math.isnan(value) else float(value)


def _cells(value: Any, names: tuple[str, ...]) -> list[float | None]:
    return [_number(getattr(value, name)) for name in names]


def imu_cells(message: Any) -> list[float | None]:
    """Return specific force (m/s2) and angular velocity (rad/s) of a sensor_msgs/Imu.

    Cells of what was not measured are empty.
    """
    return [
        *_measured(message, "linear_acceleration", _XYZ),
        *_measured(message, "angular_velocity", _XYZ),
    ]


def _measured(message: Any, what: str, names: tuple[str, ...]) -> list[float | None]:
    """Return a quantity of an IMU; empty cells if the first value of its covariance is -1.

    The definition of sensor_msgs/Imu says so: https://github.com/ros2/common_interfaces
    """
    has_none = getattr(message, f"{what}_covariance")[0] == -1
    return [None] * len(names) if has_none else _cells(getattr(message, what), names)


def pose_cells(pose: Any) -> list[Cell]:
    """Return position (m) and orientation (xyzw) of a geometry_msgs/Pose."""
    return [*_cells(pose.position, _XYZ), *_cells(pose.orientation, _XYZW)]


def _imu(message: Any) -> list[list[Cell]]:
    return [[*imu_cells(message), *_measured(message, "orientation", _XYZW)]]


def _odometry(message: Any) -> list[list[Cell]]:
    twist = message.twist.twist
    speeds = [*_cells(twist.linear, _XYZ), *_cells(twist.angular, _XYZ)]
    return [[*pose_cells(message.pose.pose), *speeds]]


def _joints(message: Any) -> list[list[Cell]]:
    """Return a row for each joint; what the message does not say of it, also its name, is empty."""
    names = [escaped(name) for name in message.name]
    numbers = [
        [_number(value) for value in values]
        for values in (message.position, message.velocity, message.effort)
    ]
    return [list(row) for row in zip_longest(names, *numbers)]


def _wrench(message: Any) -> list[list[Cell]]:
    wrench = message.wrench
    return [[*_cells(wrench.force, _XYZ), *_cells(wrench.torque, _XYZ)]]


IMU, ODOMETRY = "sensor_msgs/msg/Imu", "nav_msgs/msg/Odometry"
SERIES_KINDS: Mapping[str, SeriesKind] = {
    IMU: SeriesKind(name="imu", columns=("ax", "ay", "az", "wx", "wy", "wz", *_QUAT), rows=_imu),
    ODOMETRY: SeriesKind(
        name="odometry",
        columns=("px", "py", "pz", *_QUAT, "vx", "vy", "vz", "wx", "wy", "wz"),
        rows=_odometry,
    ),
    "sensor_msgs/msg/JointState": SeriesKind(
        name="joints", columns=("joint", "position", "velocity", "effort"), rows=_joints
    ),
    "geometry_msgs/msg/WrenchStamped": SeriesKind(
        name="force", columns=("fx", "fy", "fz", "tx", "ty", "tz"), rows=_wrench
    ),
}
"""By type of messages. Units are SI."""
