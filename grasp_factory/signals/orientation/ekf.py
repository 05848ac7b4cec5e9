"""The extended Kalman filter of ahrs."""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.signals.orientation.base import (
    InertialSeries,
    OrientationFilter,
    level_start,
    xyzw,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class EkfSettings:
    """Noise that the filter assumes; the defaults are those of ahrs."""

    gyroscope_std: float = 0.3
    """rad/s."""
    accelerometer_std: float = 0.5
    """m/s2; it includes the motion's acceleration, which the filter takes for noise."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the value.
        """
        normalise(self)
        check_range(self, "gyroscope_std", 1e-6, 100.0, "rad/s")
        check_range(self, "accelerometer_std", 1e-6, 1000.0, "m/s2")


def ekf(series: InertialSeries, settings: EkfSettings) -> Array:
    """Return orientations (N, 4) xyzw."""
    from ahrs.filters import EKF as AhrsEkf

    found = AhrsEkf(
        gyr=series.angular_velocity,
        acc=series.specific_force,
        frequency=series.rate_hz,
        # With "ENU" ahrs takes gravity, not specific force, for the reading: upside down. "NED"
        # has its reference along +z, which is where specific force points in a world with z up.
        frame="NED",
        var_gyr=settings.gyroscope_std**2,
        var_acc=settings.accelerometer_std**2,
        q0=level_start(series.specific_force[0]),
    )
    return xyzw(np.asarray(found.Q))


EKF = OrientationFilter(
    name="ekf",
    description="Extended Kalman filter of ahrs on the quaternion.",
    settings=EkfSettings,
    function=ekf,
    modules=("ahrs",),
)
