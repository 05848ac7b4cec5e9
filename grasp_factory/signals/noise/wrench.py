"""A noise model for the wrist's force-torque sensor: offset, drift, noise, saturation, counts.

Cross-talk and wrong gains are a matrix, which ``signals.calibrate`` applies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.signals.noise.number_checks import check_figures, digitise

Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class WrenchNoise:
    """The imperfections of a force-torque sensor. Sixes are fx, fy, fz (N), tx, ty, tz (N m)."""

    noise: Six
    """Standard deviation of one reading."""
    drift: Six
    """Random walk of the zero point, N/sqrt(s) and N m/sqrt(s)."""
    idle: float
    """Seconds between taring and the start of a series; the zero point drifts in this time."""
    full_scale: Six
    resolution: Six
    """Per count; 0 for no quantisation."""

    def __post_init__(self) -> None:
        """Check the figures (``check_figures``)."""
        check_figures(self)


# ATI Mini45, calibration SI-145-5 (ATI's table of the model): ranges and resolutions.
_RANGE = (145.0, 145.0, 290.0, 5.0, 5.0, 5.0)
_RESOLUTION = (1 / 16, 1 / 16, 1 / 16, 1 / 752, 1 / 752, 1 / 1504)

MINI45 = WrenchNoise(
    full_scale=_RANGE,
    # Assumption: ATI's resolution is the sigma of one reading, as it is when the gauges are noisier
    # than the converter.
    noise=_RESOLUTION,
    # Assumption: a converter of 16 bits over both signs.
    resolution=tuple(value / 2**15 for value in _RANGE),  # type: ignore[arg-type]
    # Assumptions: in ten minutes the zero point drifts by one sigma of the noise, and the sensor
    # was tared ten minutes ago.
    drift=tuple(value / math.sqrt(600.0) for value in _RESOLUTION),  # type: ignore[arg-type]
    idle=600.0,
)
"""Like ATI's Mini45."""


def corrupt(
    noise: WrenchNoise,
    wrench: ArrayLike,
    rate_hz: float,
    seed: int | np.random.SeedSequence,
) -> Array:
    """Return the wrenches that a noisy sensor would have measured.

    They are wrench + offset + random walk + white noise, rounded to counts, then saturated.

    Args:
        noise: The sensor, e.g. ``MINI45``.
        wrench: (T, 6) force N, torque N m, without noise.
        rate_hz: Records per second.
        seed: The same seed yields the same noise. Each kind of noise has its own random stream: a
            longer series starts with the same noise as a shorter one.
    """
    wrench = np.asarray(wrench, np.float64)
    start, walk, white = (np.random.default_rng(s) for s in _spawn(seed))
    drift = np.array(noise.drift)
    offset = drift * math.sqrt(noise.idle) * start.standard_normal(6)
    steps = drift / math.sqrt(rate_hz) * walk.standard_normal(wrench.shape)
    hiss = np.array(noise.noise) * white.standard_normal(wrench.shape)
    read = wrench + offset + np.cumsum(steps, axis=0) + hiss
    return digitise(read, noise.resolution, noise.full_scale)


def _spawn(seed: int | np.random.SeedSequence) -> list[np.random.SeedSequence]:
    # A copy: a sequence counts its children, and the same seed must yield the same ones again.
    seeds = np.random.SeedSequence(seed) if isinstance(seed, int) else seed
    return np.random.SeedSequence(seeds.entropy, spawn_key=seeds.spawn_key).spawn(3)
