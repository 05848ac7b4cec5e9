"""The joint motion of the shake after the hold. Pure numpy."""

from __future__ import annotations

import math

import numpy as np

from grasp_factory.core.config.shake import SHORTEST_CYCLE, STANDARD_GRAVITY, ShakeConfig
from grasp_factory.core.elementary import sincos
from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import product, solve_definite
from grasp_factory.robots.kinematics import Chain
from grasp_factory.robots.trajectory import Trajectory

_DAMPING = 1e-10
"""Damping of the inverse Jacobian, as in ``least_squares``; it bounds joints at singularities."""


def plan_shake(
    chain: Chain, posture: Array, level: float, shake: ShakeConfig, rates: tuple[int, int]
) -> list[Trajectory]:
    """Return the motions of one level: along world x, y and z, then about the approach axis.

    The motions are so small (millimetres) that the Jacobian maps them to the joints. Each takes
    ``shake.cycle_s``, or less where a joint would exceed its velocity limit: for a given
    acceleration, the speed is larger in a longer motion.

    Args:
        chain: The arm.
        posture: Joint positions of the arm, (J,) rad.
        level: Peak acceleration in units of standard gravity.
        shake: Settings of the shake.
        rates: Physics rate and control rate, Hz.
    """
    T, J = chain.fk_and_jacobian(posture)
    A = product(J, J.T) + _DAMPING * np.eye(6)
    acceleration = level * STANDARD_GRAVITY
    twists = np.zeros((4, 6))
    twists[:3, :3] = acceleration * np.eye(3)
    twists[3, 3:] = acceleration / shake.lever * T[:3, 2]
    motions = []
    for twist in twists:
        joints = (J * solve_definite(A, twist)[:, None]).sum(axis=0)  # rad/s2, at the peak
        fastest = float((np.abs(joints) / chain.velocity_limits).max()) * _PEAK_SPEED
        seconds = min(shake.cycle_s, 1.0 / fastest)
        motions.append(_pulse(posture, joints, seconds, rates))
    return motions


def _pulse(posture: Array, joints: Array, seconds: float, rates: tuple[int, int]) -> Trajectory:
    """Return a motion back and forth with the peak acceleration ``joints`` (J,), rad/s2.

    Its duration is a whole number of control periods, the largest within ``seconds`` but at least
    four.
    """
    hz, control_hz = rates
    steps = max(SHORTEST_CYCLE, math.floor(seconds * control_hz)) * (hz // control_hz)
    duration = steps / hz
    position, speed = _shape(np.arange(1, steps + 1) / steps)
    amplitude = joints * (duration * duration / _PEAK)
    return Trajectory(
        posture + position[:, None] * amplitude, speed[:, None] * amplitude / duration
    )


def _shape(tau: Array) -> tuple[Array, Array]:
    """Return position and speed of sin(2 pi t) sin(pi t)^2 at times (S,) in [0, 1].

    It starts and ends at rest, and the peak acceleration is the same in both directions.
    """
    (sine, _), (sine_of_twice, cosine_of_twice) = sincos(np.pi * tau), sincos(2.0 * np.pi * tau)
    square = sine * sine
    speed = np.pi * (2.0 * cosine_of_twice * square + sine_of_twice * sine_of_twice)
    return sine_of_twice * square, speed


_FINE = np.linspace(0.0, 1.0, 10_001)
_PEAK = float(np.abs(np.gradient(_shape(_FINE)[1], _FINE)).max())
"""Peak acceleration of the shape."""
_PEAK_SPEED = float(np.abs(_shape(_FINE)[1]).max()) / _PEAK
"""Peak speed of a motion of unit time and unit peak acceleration."""
