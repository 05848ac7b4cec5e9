"""A noise model for the IMU, applied when reading: the store holds the noiseless signal.

Convention, as in IEEE Std 952 and Kalibr: a noise density N is the strength of continuous white
noise. Sampled at a rate, this noise has a standard deviation of ``N * sqrt(rate)``, and its Allan
deviation at averaging time tau is ``N / sqrt(tau)``. The Allan deviation of a bias walk K is
``K * sqrt(tau / 3)``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.config.shake import STANDARD_GRAVITY
from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError

_Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TriadNoise:
    """The imperfections of three orthogonal axes, in the unit u of their signal."""

    noise_density: _Triple
    """White noise, u/sqrt(Hz), per axis."""
    turn_on_bias: float
    """Standard deviation, u, of the constant offset that is drawn per axis at each start."""
    bias_walk: float
    """Random walk of the bias, u/s/sqrt(Hz)."""
    full_scale: float
    """u; the output saturates at minus this value and at one resolution below plus this value."""
    resolution: float
    """u per count; 0 for no quantisation."""

    def __post_init__(self) -> None:
        """Check that no value is negative or NaN.

        Raises:
            UsageError: naming the value.
        """
        values = {name: getattr(self, name) for name in self.__slots__}
        for name, value in values.items():
            if not all(v >= 0.0 for v in np.ravel(value)):
                raise UsageError(f"IMU noise: {name} {value}: valid: 0 or more")


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuNoise:
    """The imperfections of an inertial measurement unit."""

    accelerometer: TriadNoise
    """u is m/s2."""
    gyroscope: TriadNoise
    """u is rad/s."""


class ImuReading(NamedTuple):
    """The signals that a noisy IMU would have measured."""

    specific_force: Array
    """(U, 3) m/s2, in the IMU's frame."""
    angular_velocity: Array
    """(U, 3) rad/s, in the IMU's frame."""


def walk_of_floor(noise_density: float, floor: float) -> float:
    """Return the bias walk K for which the minimum of the Allan deviation is ``floor``.

    The square of the deviation, ``N^2 / tau + K^2 tau / 3``, has its minimum, ``2 N K / sqrt(3)``,
    at ``tau = sqrt(3) N / K``.
    """
    return math.sqrt(3.0) * floor**2 / (2.0 * noise_density)


def bmi088(accelerometer_g: float = 6.0, gyroscope_deg_s: float = 2000.0) -> ImuNoise:
    """Return the noise of Bosch's BMI088 (datasheet BST-BMI088-DS001) in one of its ranges.

    Values that the datasheet does not state are assumptions; comments mark them. Datasheet
    densities are used as N. A measured Allan deviation of a BMI088 yields 0.016 deg/s/sqrt(Hz) in
    this convention; the datasheet states 0.014 (https://jpieper.com/tag/allan_variance/).

    Args:
        accelerometer_g: 3, 6 (after reset), 12 or 24.
        gyroscope_deg_s: 125, 250, 500, 1000 or 2000 (after reset).

    Raises:
        UsageError: naming the valid ranges.
    """
    for name, value, valid in (
        ("accelerometer_g", accelerometer_g, (3, 6, 12, 24)),
        ("gyroscope_deg_s", gyroscope_deg_s, (125, 250, 500, 1000, 2000)),
    ):
        if value not in valid:
            raise UsageError(f"BMI088: {name} {value}: valid: {', '.join(map(str, valid))}")
    g, degree, bits = STANDARD_GRAVITY, math.pi / 180.0, 2**15
    density = 0.014 * degree  # output noise density, typical
    # Assumption: the datasheet has no bias instability; 6.5 deg/h is the floor of the measurement
    # above, at two minutes. The accelerometer is assumed to have its floor at the same time.
    walk = walk_of_floor(density, 6.5 * degree / 3600.0)
    return ImuNoise(
        accelerometer=TriadNoise(
            noise_density=(160e-6 * g, 160e-6 * g, 190e-6 * g),  # x, y and z, typical
            turn_on_bias=20e-3 * g,  # zero-g offset, typical +-20 mg, read as one sigma
            bias_walk=160e-6 * g * walk / density,  # assumption, see above
            full_scale=accelerometer_g * g,
            resolution=accelerometer_g * g / bits,  # 16 bit, two's complement
        ),
        gyroscope=TriadNoise(
            noise_density=(density, density, density),
            turn_on_bias=1.0 * degree,  # zero-rate offset, typical +-1 deg/s, read as one sigma
            bias_walk=walk,  # assumption, see above
            full_scale=gyroscope_deg_s * degree,
            resolution=gyroscope_deg_s * degree / bits,  # 16 bit, two's complement
        ),
    )


BMI088 = bmi088()
"""The BMI088 with its ranges after a reset: 6 g and 2000 deg/s."""


def apply(
    noise: ImuNoise,
    specific_force: ArrayLike,
    angular_velocity: ArrayLike,
    rate_hz: float,
    seed: int | Sequence[int],
) -> ImuReading:
    """Return the signals that a noisy IMU would have measured.

    Per axis: signal + turn-on bias + random walk + white noise, then saturated and rounded to
    counts. Scale errors, misalignment, temperature and the sensor's low-pass filter are left out.

    Args:
        noise: The sensor, e.g. ``BMI088``.
        specific_force: (U, 3) m/s2, in the IMU's frame.
        angular_velocity: (U, 3) rad/s, in the IMU's frame.
        rate_hz: Samples per second of both.
        seed: The same seed yields the same noise; ``[seed, episode_index]`` yields different noise
            for each episode. Each kind of noise has its own random stream: a longer series starts
            with the same noise as a shorter one, and a change of the gyroscope does not change the
            noise of the accelerometer.

    Raises:
        UsageError: for a rate that is not positive.
    """
    if not rate_hz > 0.0:
        raise UsageError(f"IMU noise: rate_hz {rate_hz}: valid: above 0")
    ours, theirs = np.random.SeedSequence(seed).spawn(2)
    return ImuReading(
        _corrupt(noise.accelerometer, np.asarray(specific_force, np.float64), rate_hz, ours),
        _corrupt(noise.gyroscope, np.asarray(angular_velocity, np.float64), rate_hz, theirs),
    )


def _corrupt(
    triad: TriadNoise, signal: Array, rate_hz: float, seeds: np.random.SeedSequence
) -> Array:
    """Return a signal (U, 3) as the triad would measure it."""
    start, white, walk = (np.random.default_rng(child) for child in seeds.spawn(3))
    bias = triad.turn_on_bias * start.standard_normal(3)
    steps = triad.bias_walk / math.sqrt(rate_hz) * walk.standard_normal(signal.shape)
    density = np.array(triad.noise_density)
    noise = density * math.sqrt(rate_hz) * white.standard_normal(signal.shape)
    shown = signal + bias + np.cumsum(steps, axis=0) + noise
    if triad.resolution:
        shown = np.round(shown / triad.resolution) * triad.resolution
    return np.clip(shown, -triad.full_scale, triad.full_scale - triad.resolution)
