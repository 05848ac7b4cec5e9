"""Allan deviation of an inertial sensor at rest, and the noise figures in it."""

# ruff: noqa: PLC0415

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.errors import CaptureError

_LEAST_SAMPLES = 1000
_POINTS_PER_DECADE = 20
_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of flicker noise, per bias instability (IEEE Std 952)."""
_LEAST_AVERAGES = 9
"""Averages of a duration that the record must hold before its deviation is used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AllanCurve:
    """Allan deviation of the three axes, in the unit u of the signal."""

    tau: Array
    """(K,) averaging times, s."""
    deviation: Array
    """(K, 3) u."""
    model: Array
    """(K, 3) the fitted noise, u."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoiseFigures:
    """Noise of one axis in the convention of kalibr."""

    density: float
    """White noise N, u/sqrt(Hz): deviation ``N / sqrt(tau)``."""
    random_walk: float
    """Random walk K of the bias, u/s/sqrt(Hz): deviation ``K sqrt(tau / 3)``. 0: the record is too
    short to show it."""
    instability: float
    """Flicker noise B, u: deviation ``0.664 B``. 0 if the record does not show it."""


def allan_curve(values: ArrayLike, rate_hz: float) -> tuple[AllanCurve, tuple[NoiseFigures, ...]]:
    """Return the overlapping Allan deviation, by allantools, and the noise figures of each axis.

    The square of the deviation is a sum of three kinds of noise, ``N^2 / tau + (0.664 B)^2 + K^2
    tau / 3``. The coefficients are found by least squares that cannot be negative. A point counts
    by the number of averages in it.

    Args:
        values: (N, 3) signal at rest, u.
        rate_hz: Samples per second.

    Raises:
        CaptureError: if the record is too short, or an axis does not vary.
        MissingLibraryError: if allantools or SciPy is not installed.
    """
    require("allantools", "scipy", extra="calibration")
    import allantools
    from scipy.optimize import nnls

    values = np.asarray(values, np.float64)
    if len(values) < _LEAST_SAMPLES:
        raise CaptureError(
            f"Allan deviation: got {len(values)} samples, valid: {_LEAST_SAMPLES} or more;"
            " record the sensor at rest, for noise and walk for 3 hours"
        )
    if not values.std(axis=0).all():
        raise CaptureError("Allan deviation: an axis does not vary; check the sensor and its range")
    most = len(values) / _LEAST_AVERAGES
    count = max(2, round(_POINTS_PER_DECADE * math.log10(most)))
    wanted = np.unique(np.round(np.geomspace(1, most, count))) / rate_hz
    columns, times = [], wanted
    for axis in range(3):
        # A large mean (gravity) costs digits in the sums of allantools.
        signal = values[:, axis] - values[:, axis].mean()
        times, deviation, _, _ = allantools.oadev(
            signal, rate=rate_hz, data_type="freq", taus=wanted
        )
        columns.append(deviation)
    tau, deviations = np.asarray(times), np.column_stack(columns)
    parts = np.column_stack([1.0 / tau, np.full_like(tau, _FLOOR**2), tau / 3.0])
    weight = np.sqrt(len(values) / rate_hz / tau)  # of a relative deviation
    figures, models = [], []
    for square in (deviations**2).T:
        scale = weight / np.maximum(square, np.finfo(np.float64).tiny)
        found, _ = nnls(parts * scale[:, None], square * scale)
        white, flicker, walk = np.sqrt(found).tolist()
        figures.append(NoiseFigures(density=white, random_walk=walk, instability=flicker))
        models.append(np.sqrt(parts @ found))
    curve = AllanCurve(tau=tau, deviation=deviations, model=np.column_stack(models))
    return curve, tuple(figures)
