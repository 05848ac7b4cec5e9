"""The filter of imufusion: Madgwick's later algorithm, with rejection of motion, in C."""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.signals.orientation.base import (
    STANDARD_GRAVITY,
    InertialSeries,
    OrientationFilter,
    level_start,
    xyzw,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionSettings:
    """Settings of imufusion; the defaults are those of its examples."""

    gain: float = 0.5
    """Influence of the accelerometer."""
    acceleration_rejection_deg: float = 10.0
    """Tilt error above which the accelerometer is ignored for a time, degrees; 0 for never."""
    recovery_s: float = 5.0
    """After this time it is used again, seconds."""
    gyroscope_range_deg_s: float = 2000.0
    """Full scale; the filter starts again after a reading near it."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the value.
        """
        normalise(self)
        check_range(self, "gain", 0.0, 100.0)
        check_range(self, "acceleration_rejection_deg", 0.0, 90.0, "degrees")
        check_range(self, "recovery_s", 0.0, 3600.0, "s")
        check_range(self, "gyroscope_range_deg_s", 1.0, 10_000.0, "deg/s")


def fusion(series: InertialSeries, settings: FusionSettings) -> Array:
    """Return orientations (N, 4) xyzw."""
    import imufusion

    filter_ = imufusion.Ahrs()
    filter_.set_settings(
        imufusion.AhrsSettings(
            sample_rate=series.rate_hz,
            convention=imufusion.CONVENTION_NWU,
            gain=settings.gain,
            gyroscope_range=settings.gyroscope_range_deg_s,
            acceleration_rejection=settings.acceleration_rejection_deg,
            rejection_timeout=round(settings.recovery_s * series.rate_hz),
        )
    )
    filter_.skip_startup()
    filter_.set_quaternion(level_start(series.specific_force[0]))
    speeds = np.degrees(series.angular_velocity)
    forces = series.specific_force / STANDARD_GRAVITY
    found = np.empty((len(speeds), 4))
    for k, (speed, force) in enumerate(zip(speeds, forces, strict=True)):
        filter_.update_no_magnetometer(speed, force)
        found[k] = filter_.get_quaternion()
    return xyzw(found)


FUSION = OrientationFilter(
    name="fusion",
    description="imufusion: Madgwick's later algorithm, which ignores strong motion; fast.",
    settings=FusionSettings,
    function=fusion,
    modules=("imufusion",),
)
