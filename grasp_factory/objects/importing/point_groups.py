"""Join groups of points until there are few enough. Runs in the child process."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.objects.importing.base import UnusableError

MAX_GROUPS = 1000
"""The computing time grows with the third power of their number."""


def joined(groups: Sequence[Array], room: int) -> list[Array]:
    """Join the two groups with the smallest common box until there are at most ``room``.

    Args:
        groups: points, (n, 3) each.
        room: largest number of groups, 1 or more.

    Raises:
        UnusableError: if there are more than ``MAX_GROUPS``.
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
    """Return the sum of the sides of the common box of each group and group i; infinite for i."""
    sides = (np.maximum(high, high[i]) - np.minimum(low, low[i])).sum(axis=1)
    sides[i] = np.inf
    return np.asarray(sides)
