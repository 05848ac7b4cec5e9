"""The complementary filter of ahrs: tilt of the accelerometer with a weight."""

# ruff: noqa: PLC0415

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.signals.orientation.base import InertialSeries, OrientationFilter, xyzw


@dataclass(frozen=True, slots=True, kw_only=True)
class ComplementarySettings:
    """Settings of the complementary filter."""

    gain: float = 0.9
    """Weight of the gyroscope in each sample, 0 to 1; ahrs's default is 0.9."""

    def __post_init__(self) -> None:
        """Check the gain.

        Raises:
            ConfigError: if it is out of range.
        """
        normalise(self)
        check_range(self, "gain", 0.0, 1.0)


def complementary(series: InertialSeries, settings: ComplementarySettings) -> Array:
    """Return orientations (N, 4) xyzw."""
    from ahrs.filters import Complementary

    found = Complementary(
        gyr=series.angular_velocity,
        acc=series.specific_force,
        frequency=series.rate_hz,
        gain=settings.gain,
    )
    return xyzw(np.asarray(found.Q))


COMPLEMENTARY = OrientationFilter(
    name="complementary",
    description="Complementary filter of ahrs: gyroscope and tilt with fixed weights.",
    settings=ComplementarySettings,
    function=complementary,
    modules=("ahrs",),
)
