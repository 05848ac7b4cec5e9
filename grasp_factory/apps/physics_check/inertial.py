"""The IMU at rest, and its noise model against its own densities."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from grasp_factory.apps.physics_check.figure import Figure, at_most
from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array
from grasp_factory.signals import BMI088, apply_imu_noise

NOISE_HZ = 400
NOISE_S = 2000
TAU = 0.25
"""Averaging time, seconds, at which white noise dominates; the bias walk does so after minutes."""
REST_S = 0.2
"""Seconds at the end of the hold that count as rest."""


def at_rest(episodes: Iterable[Episode]) -> list[Figure]:
    """Compare the specific force at rest with gravity, in per cent of it."""
    errors: list[float] = []
    for episode in episodes:
        held = episode.streams["timestamp"][episode.streams["phase"] == Phase.HOLD]
        if not len(held):
            continue
        times = episode.imu["timestamp"]
        rest = (times > held[-1] - REST_S) & (times <= held[-1])
        force = np.linalg.norm(episode.imu["specific_force"][rest].astype(np.float64), axis=1)
        gravity = episode.spec.physics.gravity
        errors.extend(100.0 * np.abs(force - gravity) / gravity)
    worst = float(np.median(errors)) if errors else np.nan
    return [at_most("IMU at rest against gravity", "median error", worst, 0.1, unit="%",
                    samples=len(errors))]  # fmt: skip


def noise_model() -> list[Figure]:
    """Compare the noise model's Allan deviation with its densities, in per cent, worst axis."""
    still = np.zeros((NOISE_S * NOISE_HZ, 3))
    reading = apply_imu_noise(BMI088, still, still, NOISE_HZ, seed=0)
    figures = []
    for name, signal, noise in (
        ("accelerometer", reading.specific_force, BMI088.accelerometer),
        ("gyroscope", reading.angular_velocity, BMI088.gyroscope),
    ):
        expected = np.array(noise.noise_density) / np.sqrt(TAU)
        error = 100.0 * np.abs(_allan_deviation(signal) / expected - 1.0).max()
        figures.append(at_most(f"IMU noise, {name}: Allan deviation at {TAU} s against density",
                               "worst axis", error, 10.0, unit="%"))  # fmt: skip
    return figures


def _allan_deviation(signal: Array) -> Array:
    """Return the Allan deviation (3,) at ``TAU`` of a signal (n, 3), without overlap (IEEE 952)."""
    means = signal.reshape(-1, int(TAU * NOISE_HZ), 3).mean(axis=1)
    return np.asarray(np.sqrt(np.mean(np.diff(means, axis=0) ** 2, axis=0) / 2.0))
