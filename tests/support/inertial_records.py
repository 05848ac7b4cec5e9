"""Recordings of an inertial sensor at rest, and in still positions, with known errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_factory.signals import BMI088
from grasp_factory.signals.noise.imu import ImuNoise, apply

Array = NDArray[np.float64]
G = 9.80665
BIAS = np.array([0.15, -0.1, 0.05])
GYRO_BIAS = np.array([0.01, -0.02, 0.005])
MATRIX = np.array([[1.02, 0.012, -0.007], [0.0, 0.98, 0.009], [0.0, 0.0, 1.01]])
SLOPE = np.array([1e-4, -5e-5, 2e-5])
"""rad/s per kelvin."""
Record = tuple[Array, Array, Array]
"""Times (N,), specific force and angular velocity (N, 6), temperature (N,)."""


def still_record(*, seconds: float, rate_hz: float) -> Record:
    """Return a record at rest that warms up by 10 K, with the noise of a BMI088."""
    times = np.arange(int(seconds * rate_hz)) / rate_hz
    warm = 25.0 + 10.0 * times / seconds
    speed = GYRO_BIAS + (warm - warm.mean())[:, None] * SLOPE
    return times, _noisy(np.tile([0.0, 0.0, G], (len(times), 1)), speed, rate_hz), warm


def positions_record(*, count: int, rate_hz: float, aligned: bool) -> Record:
    """Return a record of positions of 6 s each, with a turn of 1 s between them."""
    rng = np.random.default_rng(7)
    rest, turn = int(6 * rate_hz), int(rate_hz)
    ups = np.concatenate([np.eye(3), -np.eye(3)]) if aligned else rng.standard_normal((count, 3))
    ups = ups / np.linalg.norm(ups, axis=1, keepdims=True)
    parts = []
    for k, up in enumerate(ups):
        parts.append(np.tile(G * up, (rest, 1)))
        way = np.linspace(0.0, 1.0, turn)[:, None]
        ahead = ups[(k + 1) % len(ups)]
        parts.append(G * (up + way * (ahead - up)) + rng.normal(0.0, 1.0, (turn, 3)))
    true = np.concatenate(parts)
    raw = true @ np.linalg.inv(MATRIX).T + BIAS
    times = np.arange(len(raw)) / rate_hz
    return times, _noisy(raw, np.zeros_like(raw), rate_hz), np.full(len(raw), np.nan)


def _noisy(force: Array, speed: Array, rate_hz: float) -> Array:
    """Return readings (N, 6) without a turn-on bias, so that the errors are the ones above."""
    triads = (BMI088.accelerometer, BMI088.gyroscope)
    plain = ImuNoise(
        accelerometer=replace(triads[0], turn_on_bias=0.0),
        gyroscope=replace(triads[1], turn_on_bias=0.0),
    )
    return np.column_stack(apply(plain, force, speed, rate_hz, seed=2))


def write_csv(path: Path, times: Array, values: Array, temperature: Array) -> None:
    """Write a record as a CSV file."""
    with path.open("w", encoding="utf-8") as file:
        file.write("timestamp,ax,ay,az,wx,wy,wz,temperature\n")
        for time, row, warm in zip(times, values.tolist(), temperature, strict=True):
            end = "" if np.isnan(warm) else f"{warm:.4f}"
            file.write(",".join([f"{time:.6f}", *map(repr, row), end]) + "\n")
