"""No filter: the gyroscope alone, integrated from a level start. Tilt drifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.signals.orientation.base import (
    InertialSeries,
    OrientationFilter,
    level_start,
    xyzw,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroscopeSettings:
    """It has no settings."""


def integrate(series: InertialSeries, settings: GyroscopeSettings) -> Array:
    """Return orientations (N, 4) xyzw: each sample turns the one before by its rotation vector."""
    half = series.angular_velocity / series.rate_hz / 2.0
    angle = np.linalg.norm(half, axis=1)
    steps = np.column_stack([np.cos(angle), half * np.sinc(angle / np.pi)[:, None]])
    found = np.empty((len(half), 4))
    q = found[0] = level_start(series.specific_force[0])
    for k in range(1, len(found)):
        q = found[k] = _product(q, steps[k])
    return xyzw(found / np.linalg.norm(found, axis=1, keepdims=True))


def _product(a: Array, b: Array) -> Array:
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([w, *v])


GYROSCOPE = OrientationFilter(
    name="gyroscope",
    description="The gyroscope alone, integrated; a comparison for the others.",
    settings=GyroscopeSettings,
    function=integrate,
)
