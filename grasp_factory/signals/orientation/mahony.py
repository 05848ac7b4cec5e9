"""Mahony's filter of ahrs (Mahony, Hamel and Pflimlin 2008)."""

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
class MahonySettings:
    """Gains of Mahony's filter; the defaults are those of the paper."""

    proportional: float = 1.0
    """k_P, 1/s."""
    integral: float = 0.3
    """k_I, 1/s2: follows the gyroscope's bias. 0 turns that off."""

    def __post_init__(self) -> None:
        """Check the gains.

        Raises:
            ConfigError: naming the gain.
        """
        normalise(self)
        check_range(self, "proportional", 1e-6, 1000.0)
        check_range(self, "integral", 0.0, 1000.0)


def mahony(series: InertialSeries, settings: MahonySettings) -> Array:
    """Return orientations (N, 4) xyzw."""
    from ahrs.filters import Mahony

    found = Mahony(
        gyr=series.angular_velocity,
        acc=series.specific_force,
        frequency=series.rate_hz,
        k_P=settings.proportional,
        k_I=settings.integral or np.finfo(np.float64).tiny,  # ahrs refuses 0
        q0=level_start(series.specific_force[0]),
    )
    return xyzw(np.asarray(found.Q))


MAHONY = OrientationFilter(
    name="mahony",
    description="Mahony's filter of ahrs; it follows the gyroscope's bias.",
    settings=MahonySettings,
    function=mahony,
    modules=("ahrs",),
)
