"""What devices yield: a payload with the device's time, the host's time and a number."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraFrame:
    """The images of a camera at one instant."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    depth: NDArray[np.uint16] | None = None
    """(H, W) millimetres along the optical axis, aligned with ``rgb``; 0 where not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialReading:
    """A sample of an inertial measurement unit, in its own axes."""

    specific_force: Vector
    """(3,) m/s2; at rest 9.81 upwards."""
    angular_velocity: Vector
    """(3,) rad/s."""
    temperature: float = float("nan")
    """Degrees Celsius; NaN if it is not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WrenchReading:
    """A sample of a force-torque sensor, in its own axes."""

    wrench: Vector
    """(6,) force N, torque N m: the load on the sensor."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TactileReading:
    """A sample of an array of taxels."""

    pressure: Vector
    """(rows, columns) in the unit of the setting ``unit``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JointReading:
    """State and command of an arm and its gripper. NaN is what the robot does not report."""

    positions: Vector
    """(J,) rad."""
    velocities: Vector
    """(J,) rad/s."""
    torques: Vector
    """(J,) N m."""
    position_targets: Vector
    """(J,) rad, commanded."""
    gripper_width: float = float("nan")
    """Metres."""
    gripper_width_target: float = float("nan")
    """Metres, commanded."""
    gripper_force: float = float("nan")
    """Newtons."""
    is_stopped: bool = False
    """Whether an emergency stop is active."""


class DeviceKind(IntEnum):
    """Kinds of devices, by what they yield."""

    CAMERA = 0
    IMU = 1
    FORCE_TORQUE = 2
    TACTILE = 3
    JOINTS = 4


Payload = CameraFrame | InertialReading | WrenchReading | TactileReading | JointReading
Payload_co = TypeVar("Payload_co", bound=Payload, covariant=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample(Generic[Payload_co]):
    """One sample of a device."""

    device_ns: int | None
    """The device's own time, nanoseconds from an instant that only it knows; None without one."""
    host_ns: int
    """``time.monotonic_ns()`` of this machine when the sample's last byte had arrived."""
    sequence: int | None
    """The device's own count of its samples, unwrapped; None without one."""
    payload: Payload_co
