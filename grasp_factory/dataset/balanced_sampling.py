"""Drawing rows so that every class has as many as the others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import UsageError, shown


def draw_evenly(classes: NDArray[Any], n: int | None, seed: int) -> NDArray[np.int64]:
    """Return n places in ``classes``, in random order, with as many of each class.

    The numbers of any two classes differ by one at most; which have one more is drawn too. No
    place comes twice before all places of its class have come once, and so on.

    Args:
        classes: The class of each place, (N,): words, truth values or whole numbers.
        n: How many; None for as many as there are without repeating any: the smallest class's
            number, times the classes.
        seed: The same seed gives the same places.

    Returns:
        (n,).

    Raises:
        UsageError: if there are fewer than two classes, or for an n or a seed that is none.
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
