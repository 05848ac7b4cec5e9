"""A smooth motion of an inertial sensor with its exact signals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, 9.80665])
_FINER = 10
"""Steps between two samples in which the motion is differentiated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class InertialMotion:
    """The truth of a motion."""

    quat_xyzw: Array
    """(N, 4) R_world_imu."""
    specific_force: Array
    """(N, 3) m/s2."""
    angular_velocity: Array
    """(N, 3) rad/s; the mean since the sample before."""


def inertial_motion(
    *,
    seconds: float,
    rate_hz: float,
    seed: int,
    turn: float = 0.6,
    reach: float = 0.08,
    rest: float = 0.0,
) -> InertialMotion:
    """Return a motion of sums of sines, like an arm that moves an object about.

    Args:
        seconds: Duration.
        rate_hz: Samples per second.
        seed: of frequencies and phases.
        turn: Amplitude of each angle, rad.
        reach: Amplitude of each coordinate, m.
        rest: Seconds at rest, level, before the motion sets in within a second.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(int(seconds * rate_hz * _FINER)) / (rate_hz * _FINER)
    angles, position = np.zeros((len(times), 3)), np.zeros((len(times), 3))
    for axis in range(3):
        for frequency, phase in zip(rng.uniform(0.1, 0.5, 2), rng.uniform(0, 6.3, 2), strict=True):
            angles[:, axis] += turn / 2 * np.sin(2 * np.pi * frequency * times + phase)
        frequency, phase = rng.uniform(0.2, 0.6), rng.uniform(0, 6.3)
        position[:, axis] = reach * np.sin(2 * np.pi * frequency * times + phase)
    if rest:
        share = np.clip(times - rest, 0.0, 1.0)
        ramp = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)  # without a step in acceleration
        angles, position = angles * ramp[:, None], position * ramp[:, None]
    step = times[1]
    acceleration = np.gradient(np.gradient(position, step, axis=0), step, axis=0)
    rotation = Rotation.from_euler("xyz", angles)[::_FINER]
    force = rotation.inv().apply(acceleration[::_FINER] + GRAVITY)
    steps = (rotation[:-1].inv() * rotation[1:]).as_rotvec() * rate_hz
    return InertialMotion(
        quat_xyzw=rotation.as_quat(),
        specific_force=force,
        angular_velocity=np.concatenate([steps[:1], steps]),
    )


def tilt_errors(found: Array, truth: Array) -> Array:
    """Return the angles (N,) between the found and the true vertical, degrees."""
    up = Rotation.from_quat(found).inv().apply([0.0, 0.0, 1.0])
    true = Rotation.from_quat(truth).inv().apply([0.0, 0.0, 1.0])
    return np.degrees(2.0 * np.arcsin(np.clip(np.linalg.norm(up - true, axis=1) / 2.0, 0.0, 1.0)))
