"""White noise of an IMU at rest, to compare with its calibration.

The Allan deviation at one sample of white noise of density N is N * sqrt(rate) (IEEE Std 952;
the convention of kalibr's imu.yaml). Slow motion and bias hardly change it, vibration does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array

WINDOW_S = 0.5
"""Length of the windows in which the IMU must be at rest."""
_PARTS = 5
"""Parts of a window whose means are compared."""
_STILL_ANGULAR, _STILL_FORCE = 0.02, 0.1
"""rad/s and m/s2 by which the means of the parts may differ, and rad/s of the window's mean from
the median of all, beside what noise explains."""
_SIGMAS = 6.0
"""Standard deviations of the mean of a part that noise explains."""


class NoiseDensities(NamedTuple):
    """White noise of an IMU, as in kalibr's imu.yaml."""

    accelerometer: float
    """m/s2/sqrt(Hz)."""
    gyroscope: float
    """rad/s/sqrt(Hz)."""


def static_samples(
    specific_force: Array, angular_velocity: Array, rate: float
) -> NDArray[np.bool_]:
    """Return which samples (N,) are in windows at rest.

    What differs from window to window is compared with the noise itself, so that a noisy IMU is
    not taken for a moving one.

    Args:
        specific_force: (N, 3) m/s2.
        angular_velocity: (N, 3) rad/s.
        rate: Hz.
    """
    length = max(_PARTS * 4, round(WINDOW_S * rate) // _PARTS * _PARTS)
    windows = len(specific_force) // length
    if not windows:
        return np.zeros(len(specific_force), np.bool_)
    is_still = np.ones(windows, np.bool_)
    for values, most in ((specific_force, _STILL_FORCE), (angular_velocity, _STILL_ANGULAR)):
        parts = values[: windows * length].reshape(windows, _PARTS, -1, 3).mean(axis=2)
        allowed = most + _SIGMAS * _white_sigma(values) / math.sqrt(length / _PARTS)
        is_still &= (np.ptp(parts, axis=1) < allowed).all(axis=1)
        if values is angular_velocity:
            away = np.abs(parts.mean(axis=1) - np.median(values, axis=0))
            is_still &= (away < allowed).all(axis=1)
    return np.concatenate(
        [np.repeat(is_still, length), np.zeros(len(specific_force) - windows * length, np.bool_)]
    )


def noise_densities(specific_force: Array, angular_velocity: Array, rate: float) -> NoiseDensities:
    """Return the noise of the noisiest axis of each sensor at rest; NaN without a time at rest."""
    still = static_samples(specific_force, angular_velocity, rate)
    pairs = still[1:] & still[:-1]
    if not pairs.any():
        return NoiseDensities(math.nan, math.nan)
    force, angular = (
        math.sqrt(float((np.diff(values, axis=0)[pairs] ** 2).mean(axis=0).max()) / 2.0 / rate)
        for values in (specific_force, angular_velocity)
    )
    return NoiseDensities(force, angular)


def _white_sigma(values: Array) -> Array:
    """Return the standard deviation (3,) of white noise, from the median of differences.

    0.6745 is the third quartile of the normal distribution; two samples differ by sqrt(2) sigma.
    """
    differences = np.abs(np.diff(values, axis=0))
    return np.asarray(np.median(differences, axis=0) / 0.6745 / math.sqrt(2.0))
