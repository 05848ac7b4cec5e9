"""What orientation filters share: their row, their input, and the start from gravity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import UsageError

STANDARD_GRAVITY = 9.80665
"""m/s2."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialSeries:
    """Samples of an inertial sensor at a constant rate, in its own axes."""

    specific_force: Array
    """(N, 3) m/s2."""
    angular_velocity: Array
    """(N, 3) rad/s."""
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class OrientationFilter:
    """A row of the table of filters."""

    name: str
    description: str
    settings: type[Any]
    """A frozen dataclass."""
    function: Callable[[InertialSeries, Any], Array]
    """Returns (N, 4) quaternions xyzw of ``R_world_imu`` from a series and the settings."""
    modules: tuple[str, ...] = ()
    """Import names of its libraries, of the extra ``filters``."""

    def settings_from(self, plain: Mapping[str, Any]) -> Any:
        """Return the settings from plain data.

        Raises:
            ConfigError: for a setting that is unknown or out of range.
        """
        return from_plain(self.settings, plain, self.name)


def inertial_series(
    specific_force: ArrayLike, angular_velocity: ArrayLike, rate_hz: float
) -> InertialSeries:
    """Return a checked series.

    Raises:
        UsageError: for other shapes, values that are not finite, or a rate that is not positive.
    """
    force = np.asarray(specific_force, np.float64)
    speed = np.asarray(angular_velocity, np.float64)
    if force.ndim != 2 or force.shape[1] != 3 or force.shape != speed.shape or not len(force):
        got = f"got {force.shape} and {speed.shape}"
        raise UsageError(f"inertial series: {got}, valid: (N, 3) of both, N of 1 or more")
    if not (np.isfinite(force).all() and np.isfinite(speed).all()):
        raise UsageError("inertial series: values that are not finite; valid: numbers only")
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise UsageError(f"inertial series: rate_hz {rate_hz}, valid: above 0")
    if not np.linalg.norm(force[0]) > 0.0:
        raise UsageError("inertial series: the first specific force is 0; valid: gravity")
    return InertialSeries(specific_force=force, angular_velocity=speed, rate_hz=rate_hz)


def level_start(specific_force: Array) -> Array:
    """Return the quaternion wxyz whose tilt is that of one specific force (3,), with yaw 0."""
    x, y, z = specific_force
    roll, pitch = np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
    cr, sr, cp, sp = np.cos(roll / 2), np.sin(roll / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    return np.array([cr * cp, sr * cp, cr * sp, -sr * sp])


def xyzw(quat_wxyz: ArrayLike) -> Array:
    """Return quaternions with the scalar last."""
    return np.roll(np.asarray(quat_wxyz, np.float64), -1, axis=-1)
