"""Inverse kinematics by damped least squares from many starts at once, within the joint limits.

The damping is Sugihara's (T-RO 27(5), 2011). A joint that a step would push beyond its limit is
fixed for this step, so that the other joints do the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import norm, product, solve_definite
from grasp_factory.robots.kinematics import Chain

POSITION_TOLERANCE = 1e-6
"""Largest position error of a solution, metres."""
ORIENTATION_TOLERANCE = 1e-6
"""Largest orientation error of a solution, rad."""
_MAX_ITERATIONS = 60
# Damping proportional to the squared error keeps convergence quadratic even where the Jacobian
# loses rank (Fan & Yuan, Computing 74, 2005); with a constant above 1e-8 the descent stalls there.
_DAMPING_PER_SQUARED_ERROR = 0.1
_DAMPING_FLOOR = 1e-10
_MAX_ITERATION_STEP = 1.0  # rad; the linearisation is not valid for larger steps
_HALF_TURN = 1e-12  # limit of 4 cos(angle / 2)^2; closer to pi the sign of the axis is undefined
_STALL_ITERATIONS = 8  # a start is abandoned unless it halves its squared error in these


class Descent(NamedTuple):
    """The result of the descent from each of B starts."""

    q: Array  # (B, n) rad
    error: Array  # (B, 6) m and rad, remaining error at q
    converged: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]  # (B,)


def descend(chain: Chain, T_goal: Array, starts: Array, *, enough: int) -> Descent:
    """Improve the starts (B, n) until ``enough`` of them are solutions or no start improves.

    The goal is one pose (4, 4) for all starts, or one for each start (B, 4, 4).
    """
    goals = np.broadcast_to(T_goal, (len(starts), 4, 4))
    q = np.clip(starts, chain.lower, chain.upper)
    end = Descent(q.copy(), np.full((len(q), 6), np.inf), np.zeros(len(q), dtype=np.bool_))
    rows = np.arange(len(q))
    before = np.full(len(q), np.inf)
    for iteration in range(1, _MAX_ITERATIONS + 1):
        T, J = chain.fk_and_jacobian(q)
        error = pose_errors(T, goals)
        done = _is_within_tolerance(error)
        end.q[rows], end.error[rows], end.converged[rows] = q, error, done
        squares = squares_of(error)
        going = ~done
        if iteration % _STALL_ITERATIONS == 0:
            going &= squares < 0.5 * before
            before = squares
        if np.count_nonzero(end.converged) >= enough or not going.any():
            break
        if not going.all():
            rows, q, J, before = rows[going], q[going], J[going], before[going]
            goals = goals[going]
            error, squares = error[going], squares[going]
        q = np.clip(q + damped_step(chain, q, J, error, squares), chain.lower, chain.upper)
    return end


def damped_step(chain: Chain, q: Array, J: Array, error: Array, squares: Array) -> Array:
    """Return the step (B, n), rad, that reduces the errors (B, 6); joints at a limit stay there."""
    pull = (J * error[..., None]).sum(axis=-2)
    is_held = ((q <= chain.lower) & (pull < 0.0)) | ((q >= chain.upper) & (pull > 0.0))
    J = J * ~is_held[:, None, :]
    A = product(J, np.swapaxes(J, -1, -2))
    diagonal = np.arange(6)
    A[:, diagonal, diagonal] += (_DAMPING_PER_SQUARED_ERROR * squares + _DAMPING_FLOOR)[:, None]
    step = (J * solve_definite(A, error)[..., None]).sum(axis=-2)
    largest = np.abs(step).max(axis=-1, keepdims=True)
    return np.asarray(step * (_MAX_ITERATION_STEP / np.maximum(largest, _MAX_ITERATION_STEP)))


def pose_errors(T: Array, T_goal: Array) -> Array:
    """Return the remaining error from T (B, 4, 4) to the goal, (B, 6) in base axes.

    The first three are the translation. The others are the axis of the rotation times twice the
    sine of half its angle, which is close to the angle if it is small.
    """
    R = product(T_goal[..., :3, :3], np.swapaxes(T[:, :3, :3], -1, -2))
    error = np.empty((len(T), 6))
    error[:, :3] = T_goal[..., :3, 3] - T[:, :3, 3]
    error[:, 3] = R[:, 2, 1] - R[:, 1, 2]
    error[:, 4] = R[:, 0, 2] - R[:, 2, 0]
    error[:, 5] = R[:, 1, 0] - R[:, 0, 1]
    # Four times the square of the cosine of half the angle.
    square = R[:, 0, 0] + R[:, 1, 1] + R[:, 2, 2] + 1.0
    is_half_turn = square < _HALF_TURN
    error[:, 3:] /= np.sqrt(np.where(is_half_turn, 1.0, square))[:, None]
    for i in np.flatnonzero(is_half_turn):  # R + I = 2 axis axis^T
        columns = R[i] + np.eye(3)
        axis = columns[:, np.argmax(np.diag(columns))]
        error[i, 3:] = 2.0 * axis / norm(axis)
    return error


def squares_of(v: Array) -> Array:
    """Return the squared lengths (...) of vectors (..., n)."""
    return np.asarray((v * v).sum(axis=-1))


def _is_within_tolerance(error: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    position, orientation = squares_of(error[..., :3]), squares_of(error[..., 3:])
    return np.asarray(
        (position <= POSITION_TOLERANCE * POSITION_TOLERANCE)
        & (orientation <= ORIENTATION_TOLERANCE * ORIENTATION_TOLERANCE)
    )
