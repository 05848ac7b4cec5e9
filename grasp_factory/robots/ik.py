"""Inverse kinematics of a ``Chain`` within its joint limits; pure functions, no randomness.

If the descent from one start posture does not reach a pose, it is repeated from other start
postures that are spread evenly over the range of the joints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.elementary import arctan2
from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import length
from grasp_factory.robots.kinematics import Chain
from grasp_factory.robots.least_squares import (
    POSITION_TOLERANCE,
    Descent,
    damped_step,
    descend,
    pose_errors,
    squares_of,
)

SAME_SOLUTION = 0.1
"""Postures whose joints all differ by at most this many rad count as one solution."""
MAX_JOINT_STEP = 0.2
"""Largest joint step between waypoints, rad; a change to another IK branch is much larger."""

# Measured on 540 poses of each robot, including joints at limits and singular postures: for every
# pose at least 23 % of the restarts succeed for the iiwa, at least 1 % for the Panda.
_RESTARTS = (32, 128, 512)
_SOLUTION_RESTARTS = 128
_STRIDE = 3  # waypoints; at 1 cm each, one step of the descent is accurate enough for this distance
_RATIO_ITERATIONS = 16  # twice the number needed from the start value 2, for any number of joints


@dataclass(frozen=True, slots=True)
class IKResult:
    """The best posture found for a pose, and the remaining errors of its tip."""

    joint_positions: Array
    """Posture within the joint limits; rad, shape (n,)."""
    position_error: float
    """Distance from the tip's origin to the pose's; metres."""
    orientation_error: float
    """Angle between the tip's orientation and the pose's; rad, in [0, pi]."""
    success: bool
    """Whether both errors are within the tolerances of ``least_squares``."""


@dataclass(frozen=True, slots=True)
class PathResult:
    """The postures along a Cartesian path, up to the first waypoint that the arm cannot reach."""

    joint_positions: Array
    """One row for each solved waypoint; rad, shape (S, n), with fewer rows after a failure."""
    failed_waypoint: int | None
    """Index of the first waypoint that the arm cannot reach; None if it reaches all."""

    @property
    def success(self) -> bool:
        """Whether every waypoint is solved."""
        return self.failed_waypoint is None


def solve_ik(chain: Chain, T_base_tip: ArrayLike, start: ArrayLike) -> IKResult:
    """Return a posture whose tip is at ``T_base_tip`` (4, 4), preferably close to ``start`` (n,).

    For an unreachable pose the result is the closest posture found, with ``success`` false.
    """
    return solve_each(chain, np.asarray(T_base_tip, dtype=np.float64)[None], start)[0]


def solve_each(chain: Chain, T_base_tip: ArrayLike, start: ArrayLike) -> list[IKResult]:
    """Return the results of ``solve_ik`` for poses (K, 4, 4); faster than separate calls."""
    T_goals = np.asarray(T_base_tip, dtype=np.float64)
    start = np.asarray(start, dtype=np.float64)
    starts = np.broadcast_to(start, (len(T_goals), start.size))
    found = descend(chain, T_goals, starts, enough=len(T_goals))
    return [
        _restarted(chain, T_goal, start, _result(found, row)) for row, T_goal in enumerate(T_goals)
    ]


def _restarted(chain: Chain, T_goal: Array, start: Array, best: IKResult) -> IKResult:
    """Return ``best`` if it is a solution, else the best result of the restarts."""
    if best.success or not _is_in_reach(chain, T_goal):
        return best
    first = 0
    for count in _RESTARTS:
        found = descend(chain, T_goal, _spread(chain, first, count), enough=1)
        if found.converged.any():
            times = np.where(found.converged, _travel_times(chain, found.q, start), np.inf)
            return _result(found, int(np.argmin(times)))
        closest = _result(found, int(np.argmin(squares_of(found.error))))
        best = min(best, closest, key=_squared_error)
        first += count
    return best


def ik_solutions(chain: Chain, T_base_tip: ArrayLike, start: ArrayLike) -> Array:
    """Return distinct postures (K, n) that reach a pose (4, 4), by travel time from ``start``.

    A redundant arm has a continuum of them; these are samples that differ by more than
    ``SAME_SOLUTION``. K is 0 if the pose is unreachable.
    """
    T_goal = np.asarray(T_base_tip, dtype=np.float64)
    start = np.asarray(start, dtype=np.float64)
    nearest = solve_ik(chain, T_goal, start)
    if not nearest.success:
        return np.empty((0, len(start)))
    found = descend(chain, T_goal, _spread(chain, 0, _SOLUTION_RESTARTS), enough=_SOLUTION_RESTARTS)
    postures = np.vstack([nearest.joint_positions, found.q[found.converged]])
    postures = postures[np.argsort(_travel_times(chain, postures, start), kind="stable")]
    distinct: list[int] = []
    for i, q in enumerate(postures):
        if np.all(np.abs(postures[distinct] - q).max(axis=-1) > SAME_SOLUTION):
            distinct.append(i)
    return np.asarray(postures[distinct])


def track_path(
    chain: Chain, T_path: ArrayLike, start: ArrayLike, *, max_joint_step: float = MAX_JOINT_STEP
) -> PathResult:
    """Follow waypoints (S, 4, 4) from the posture ``start`` (n,).

    No joint moves more than ``max_joint_step`` rad between waypoints, or from ``start`` to the
    first waypoint. With short steps this also bounds the deviation between waypoints: an arm of
    reach r deviates from the path by about ``r * max_joint_step**2 / 8`` metres.
    """
    start = np.asarray(start, dtype=np.float64)
    waypoints = np.asarray(T_path, dtype=np.float64)
    if not len(waypoints):
        return PathResult(np.empty((0, start.size)), None)
    guesses = _walk(chain, waypoints, start)
    found = descend(chain, waypoints, guesses, enough=len(waypoints))
    steps = np.abs(np.diff(found.q, axis=0, prepend=start[None])).max(axis=1)
    failed = np.flatnonzero(~found.converged | (steps > max_joint_step))
    if not len(failed):
        return PathResult(found.q, None)
    return PathResult(found.q[: failed[0]], int(failed[0]))


def _walk(chain: Chain, waypoints: Array, start: Array) -> Array:
    """Return a posture near each of the waypoints (S, 4, 4), shape (S, n).

    The posture at the end of each stride is one step of the descent from the posture before. The
    postures within a stride are interpolated linearly. These postures are close enough to improve
    all of them at once, which is much faster than one after the other.
    """
    count = len(waypoints)
    stops = [*range(_STRIDE - 1, count - 1, _STRIDE), count - 1]
    q = start[None]
    postures = [start]
    for stop in stops:
        T, J = chain.fk_and_jacobian(q)
        error = pose_errors(T, waypoints[stop])
        step = damped_step(chain, q, J, error, squares_of(error))
        q = np.clip(q + step, chain.lower, chain.upper)
        postures.append(q[0])
    known, steps = np.array([0, *(stop + 1 for stop in stops)]), np.arange(1, count + 1)
    after = np.searchsorted(known, steps)
    share = (steps - known[after - 1]) / (known[after] - known[after - 1])
    path = np.array(postures)
    return np.asarray(path[after - 1] + share[:, None] * (path[after] - path[after - 1]))


def _result(found: Descent, row: int) -> IKResult:
    error = found.error[row]
    return IKResult(
        joint_positions=found.q[row].copy(),
        position_error=length(error[:3]),
        orientation_error=_angle(error[3:]),
        success=bool(found.converged[row]),
    )


def _angle(error: Array) -> float:
    """Return the angle, rad, of a rotation error (3,) of length 2 sin(angle / 2)."""
    sine = min(1.0, length(error) / 2.0)
    return 2.0 * float(arctan2(sine, math.sqrt(1.0 - sine * sine)))


def _squared_error(result: IKResult) -> float:
    position, orientation = result.position_error, result.orientation_error
    return position * position + orientation * orientation


def _is_in_reach(chain: Chain, T_goal: Array) -> bool:
    distance = length(T_goal[:3, 3] - chain.T_previous_joint[0, :3, 3])
    return bool(distance <= chain.reach + POSITION_TOLERANCE)


def _travel_times(chain: Chain, postures: Array, start: Array) -> Array:
    """Return the seconds (K,) that the slowest joint needs from ``start`` to postures (K, n)."""
    return np.asarray((np.abs(postures - start) / chain.velocity_limits).max(axis=-1))


def _spread(chain: Chain, first: int, count: int) -> Array:
    """Return terms (count, n), from ``first`` on, of a sequence that fills the joint ranges evenly.

    Roberts' additive recurrence (2018); its steps are powers of the generalised golden ratio.
    """
    n = len(chain.lower)
    ratio = 2.0
    for _ in range(_RATIO_ITERATIONS):  # Newton's method for ratio^(n + 1) = 1 + ratio
        power = math.prod([ratio] * n)
        ratio -= (power * ratio - 1.0 - ratio) / ((n + 1) * power - 1.0)
    steps = 1.0 / np.cumprod(np.full(n, ratio))
    unit = (0.5 + np.arange(first + 1, first + count + 1)[:, None] * steps) % 1.0
    return np.asarray(chain.lower + unit * (chain.upper - chain.lower))
