"""Planning of the joint motion for a grasp: straight segments with minimum-jerk timing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp_factory.core.config.motion import (
    MAX_STRETCH,
    MAX_TRANSFER_S,
    PEAK_OVER_MEAN,
    SHORTEST_MOTION_S,
    MotionConfig,
)
from grasp_factory.core.episode import Grasp
from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import length
from grasp_factory.robots.ik import ik_solutions, solve_each, track_path
from grasp_factory.robots.kinematics import Chain

WAYPOINT_SPACING = 0.01
"""Distance between IK solutions on a straight segment, metres.

With interpolation between them, the TCP of both arms stays within 0.1 mm of the line.
"""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Joint targets for consecutive physics steps."""

    positions: Array
    """(S, J) rad, without the start."""
    velocities: Array
    """(S, J) rad/s."""


@dataclass(frozen=True, slots=True)
class JointSegment:
    """A path in joint space and its duration."""

    waypoints: Array
    """(K, J) rad, at equal steps along the path."""
    duration: float
    """Seconds."""


@dataclass(frozen=True, slots=True)
class GraspMotion:
    """The three motions of an attempt."""

    transfer: JointSegment
    """From home to the pregrasp."""
    approach: JointSegment
    """Straight from the pregrasp to the grasp."""
    lift: JointSegment
    """Straight up from the grasp."""


def plan_motion(
    chain: Chain, home: Array, grasps: Sequence[Grasp], motion: MotionConfig
) -> tuple[Grasp, GraspMotion] | None:
    """Return one of several equally good grasps and the motions from ``home`` (J,) that execute it.

    The grasps are tried in the order of the transfer time from home, then again with other
    pregrasp postures. The result is None if all are unreachable. A grasp is reachable if there is
    a pregrasp posture within the joint limits, at most ``MAX_TRANSFER_S`` from home, from which
    the arm can follow the straight approach and lift within the velocity limits.
    """
    paths = [_GraspPath(chain, home, grasp, motion) for grasp in grasps]
    if not paths:
        return None
    postures = solve_each(chain, np.stack([path.T_pregrasp for path in paths]), home)
    nearest = [pair for pair in zip(paths, postures, strict=True) if pair[1].success]
    nearest.sort(key=lambda pair: pair[0].transfer_s(pair[1].joint_positions))
    for path, posture in nearest:
        found = path.through(posture.joint_positions)
        if found is not None:
            return path.grasp, found
    for path, _ in nearest:
        for joint_positions in ik_solutions(chain, path.T_pregrasp, home):
            found = path.through(joint_positions)
            if found is not None:
                return path.grasp, found
    return None


def sample(segment: JointSegment, hz: int, control_hz: int) -> Trajectory:
    """Return the joint targets of a segment with minimum-jerk timing, one for each step at ``hz``.

    The duration is rounded up to a whole number of periods of ``control_hz``.
    """
    steps = math.ceil(segment.duration * control_hz) * (hz // control_hz)
    tau = np.arange(1, steps + 1) / steps
    left = tau * (1.0 - tau)
    s = tau * tau * tau * (10.0 - 15.0 * tau + 6.0 * tau * tau)
    ds_dt = 30.0 * left * left / (steps / hz)
    q, dq_ds = _interpolate(segment.waypoints, s)
    return Trajectory(q, dq_ds * ds_dt[:, None])


class _GraspPath:
    """The Cartesian path of one grasp, and the joint motions along it."""

    def __init__(self, chain: Chain, home: Array, grasp: Grasp, motion: MotionConfig) -> None:
        self.grasp = grasp
        self._chain, self._home, self._motion = chain, home, motion
        self._limits = chain.velocity_limits * motion.speed_scale
        self._T_grasp = T_grasp = grasp.T_world_tcp
        self.T_pregrasp = T_grasp.copy()
        self.T_pregrasp[:3, 3] -= motion.pregrasp_distance * T_grasp[:3, 2]
        self._T_lifted = T_grasp.copy()
        self._T_lifted[2, 3] += motion.lift_height

    def transfer_s(self, pregrasp: Array) -> float:
        """Return the duration of the motion from home to a posture (J,), seconds."""
        return self._shortest_duration(np.stack([self._home, pregrasp]))

    def through(self, pregrasp: Array) -> GraspMotion | None:
        """Return the motions through a pregrasp posture (J,), or None if one is impossible."""
        waypoints = np.stack([self._home, pregrasp])
        transfer = JointSegment(waypoints, self.transfer_s(pregrasp))
        if transfer.duration > MAX_TRANSFER_S:
            return None
        seconds = self._motion.approach_s
        approach = self._straight(pregrasp, self.T_pregrasp, self._T_grasp, seconds)
        if approach is None:
            return None
        at_grasp = approach.waypoints[-1]
        lift = self._straight(at_grasp, self._T_grasp, self._T_lifted, self._motion.lift_s)
        return None if lift is None else GraspMotion(transfer, approach, lift)

    def _straight(
        self, start: Array, T_start: Array, T_end: Array, seconds: float
    ) -> JointSegment | None:
        """Return the segment along a straight line without rotation; None if it is impossible."""
        way = T_end[:3, 3] - T_start[:3, 3]
        steps = max(2, math.ceil(length(way) / WAYPOINT_SPACING))
        T_path = np.tile(T_start, (steps, 1, 1))
        T_path[:, :3, 3] += np.arange(1, steps + 1)[:, None] / steps * way
        path = track_path(self._chain, T_path, start)
        if not path.success:
            return None
        waypoints = np.vstack([start, path.joint_positions])
        shortest = self._shortest_duration(waypoints)
        if shortest > MAX_STRETCH * seconds:
            return None
        return JointSegment(waypoints, max(seconds, shortest))

    def _shortest_duration(self, waypoints: Array) -> float:
        """Return the shortest duration in which no joint exceeds its velocity limit, seconds.

        It is infinite if the interpolated path leaves the joint limits.
        """
        q, dq_ds = _interpolate(waypoints, np.linspace(0.0, 1.0, 8 * len(waypoints)))
        if (q < self._chain.lower).any() or (q > self._chain.upper).any():
            return math.inf
        shortest = float((np.abs(dq_ds) * PEAK_OVER_MEAN / self._limits).max())
        return max(shortest, SHORTEST_MOTION_S)


def _interpolate(waypoints: Array, s: Array) -> tuple[Array, Array]:
    """Return q(s) and dq/ds, (S, J) each, of the cubic Hermite curve through waypoints (K, J).

    ``s`` (S,) is in [0, 1]. The slopes at the waypoints are finite differences
    (``numpy.gradient``), so the curve and its slope are continuous.
    """
    spans = len(waypoints) - 1
    slopes = np.gradient(waypoints, axis=0, edge_order=2 if spans > 1 else 1)
    i = np.minimum((s * spans).astype(int), spans - 1)
    t = (s * spans - i)[:, None]
    a, b, m, n = waypoints[i], waypoints[i + 1], slopes[i], slopes[i + 1]
    q = a + t * (m + t * (3 * (b - a) - 2 * m - n + t * (2 * (a - b) + m + n)))
    dq_dt = m + t * (2 * (3 * (b - a) - 2 * m - n) + 3 * t * (2 * (a - b) + m + n))
    return q, dq_dt * spans
