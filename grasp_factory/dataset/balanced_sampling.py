"""Random draws of rows, with equally many rows of each class."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import UsageError, shown


def draw_evenly(classes: NDArray[Any], n: int | None, seed: int) -> NDArray[np.int64]:
    """Return n positions in ``classes``, in random order, with equally many of each class.

    The counts of any two classes differ by at most one; which classes have one more is random. A
    position is repeated only after all positions of its class have been drawn equally often.

    Args:
        classes: The class of each position, (N,): strings, booleans or integers.
        n: How many positions to draw; None for the most that need no repetition: the size of the
            smallest class, times the number of classes.
        seed: The same seed yields the same positions.

    Returns:
        (n,).

    Raises:
        UsageError: if there are fewer than two classes, or if n or seed is invalid.
    """
    if n is not None and (not is_integer(n) or n < 1):
        raise UsageError(f"n: got {shown(n)}, valid: a whole number from 1 on, or None")
    if not is_integer(seed) or seed < 0:
        raise UsageError(f"seed: got {shown(seed)}, valid: a whole number from 0 on")
    values, member_of, sizes = np.unique(classes, return_inverse=True, return_counts=True)
    count = len(values)
    if count < 2:
        there = f"all {len(classes)} rows are of one class" if count else "there are no rows"
        raise UsageError(f"{there}, valid: rows of two classes or more")
    rng = np.random.default_rng(seed)
    each, more = divmod(count * int(sizes.min()) if n is None else int(n), count)
    quotas = each + (rng.permutation(count) < more)
    members_of = np.split(np.argsort(member_of, kind="stable"), np.cumsum(sizes)[:-1])
    drawn = []
    for members, quota in zip(members_of, quotas.tolist(), strict=True):
        rounds, rest = divmod(quota, len(members))
        drawn += [np.tile(members, rounds), rng.permutation(members)[:rest]]
    return rng.permutation(np.concatenate(drawn))
