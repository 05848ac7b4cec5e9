"""Too many groups of points put together to fewer. Runs in the child process."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.objects.importing.base import UnusableError

MAX_GROUPS = 1000
"""The work grows with the third power."""


def joined(groups: Sequence[Array], room: int) -> list[Array]:
    """Return up to ``room`` groups: two with the smallest common box become one, again and again.

    Args:
        groups: points, (n, 3) each.
        room: 1 or more.

    Raises:
        UnusableError: for more than ``MAX_GROUPS``.
    """
    if len(groups) > MAX_GROUPS:
        raise UnusableError(
            f"it falls into {len(groups)} separate pieces, valid: up to {MAX_GROUPS}; merge its"
            " vertices"
        )
    rest = list(groups)
    low = np.array([group.min(axis=0) for group in rest])
    high = np.array([group.max(axis=0) for group in rest])
    costs = np.array([_common(low, high, i) for i in range(len(rest))])
    while len(rest) > max(1, room):
        i, j = sorted(int(k) for k in np.unravel_index(np.argmin(costs), costs.shape))
        rest[i] = np.vstack([rest[i], rest.pop(j)])
        low[i], high[i] = np.minimum(low[i], low[j]), np.maximum(high[i], high[j])
        low, high = np.delete(low, j, axis=0), np.delete(high, j, axis=0)
        costs = np.delete(np.delete(costs, j, axis=0), j, axis=1)
        costs[i] = costs[:, i] = _common(low, high, i)
    return rest


def _common(low: Array, high: Array, i: int) -> Array:
    """Return the sum of the sides of each box put together with the i-th; with itself, infinite."""
    sides = (np.maximum(high, high[i]) - np.minimum(low, low[i])).sum(axis=1)
    sides[i] = np.inf
    return np.asarray(sides)
