"""Madgwick's filter of ahrs (Madgwick 2010)."""

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
class MadgwickSettings:
    """The gain of Madgwick's filter."""

    gain: float = 0.033
    """beta, rad/s; the default is the report's for a sensor without magnetometer."""

    def __post_init__(self) -> None:
        """Check the gain.

        Raises:
            ConfigError: if it is out of range.
        """
        normalise(self)
        check_range(self, "gain", 1e-6, 100.0, "rad/s")


def madgwick(series: InertialSeries, settings: MadgwickSettings) -> Array:
    """Return orientations (N, 4) xyzw."""
    from ahrs.filters import Madgwick

    found = Madgwick(
        gyr=series.angular_velocity,
        acc=series.specific_force,
        frequency=series.rate_hz,
        gain=settings.gain,
        q0=level_start(series.specific_force[0]),
    )
    return xyzw(np.asarray(found.Q))


MADGWICK = OrientationFilter(
    name="madgwick",
    description="Madgwick's gradient filter of ahrs.",
    settings=MadgwickSettings,
    function=madgwick,
    modules=("ahrs",),
)
