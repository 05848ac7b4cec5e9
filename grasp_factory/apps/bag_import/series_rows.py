"""Messages of sensors as rows of CSV files."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.text_format import escaped

Cell = float | str | None
_XYZ = ("x", "y", "z")
_QUAT = ("qx", "qy", "qz", "qw")


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesKind:
    """A kind of time series: which folder it goes to, and its rows."""

    name: str
    """Name of its folder."""
    columns: tuple[str, ...]
    rows: Callable[[Any], list[list[Cell]]]
    """Returns the rows of a message without its time."""


def _number(value: float) -> Cell:
    """Return a cell that is empty for NaN."""
    return None if math.isnan(value) else float(value)


def _cells(value: Any, names: tuple[str, ...]) -> list[Cell]:
    return [_number(getattr(value, name)) for name in names]


def _orientation(quaternion: Any) -> list[Cell]:
    return _cells(quaternion, (*_XYZ, "w"))


def imu_cells(message: Any) -> list[Cell]:
    """Return specific force (m/s2) and angular velocity (rad/s) of a sensor_msgs/Imu."""
    return [
        *_cells(message.linear_acceleration, _XYZ),
        *_cells(message.angular_velocity, _XYZ),
    ]


def imu_orientation(message: Any) -> list[Cell]:
    """Return the orientation, xyzw; empty if the message has none: its first covariance is -1."""
    has_none = message.orientation_covariance[0] == -1
    return [None] * 4 if has_none else _orientation(message.orientation)


def pose_cells(pose: Any) -> list[Cell]:
    """Return position (m) and orientation (xyzw) of a geometry_msgs/Pose."""
    return [*_cells(pose.position, _XYZ), *_orientation(pose.orientation)]


def _imu(message: Any) -> list[list[Cell]]:
    return [[*imu_cells(message), *imu_orientation(message)]]


def _odometry(message: Any) -> list[list[Cell]]:
    twist = message.twist.twist
    speeds = [*_cells(twist.linear, _XYZ), *_cells(twist.angular, _XYZ)]
    return [[*pose_cells(message.pose.pose), *speeds]]


def _joints(message: Any) -> list[list[Cell]]:
    """Return a row for each joint; what the message does not say of it is empty."""
    values = [list(message.position), list(message.velocity), list(message.effort)]
    return [
        [escaped(name), *(_number(each[k]) if k < len(each) else None for each in values)]
        for k, name in enumerate(message.name)
    ]


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
