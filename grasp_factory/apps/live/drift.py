"""A test of whether the success rate has changed in a run, with few false alarms."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

LAST = 100
"""Number of latest episodes that are compared with all episodes before them."""
FEWEST_BEFORE = 100
EVERY = 20
"""Number of episodes from one test to the next."""
FALSE_ALARMS = 0.01
"""Maximum probability that a run with a constant success probability raises an alarm."""
BACK = 0.05
"""An alarm ends when the p-value of the last episodes, given the rate before it, exceeds this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A change of the success rate that still lasts."""

    before: float
    """Share of successes among the episodes before the ``LAST`` ones, when the change was found."""
    last: float
    """Share of successes among the last ``LAST`` episodes."""


class SuccessDrift:
    """Compares the last ``LAST`` episodes with all before them, every ``EVERY`` episodes.

    Each test is exact (hypergeometric, two-sided), and they share ``FALSE_ALARMS`` equally
    (Bonferroni), so the probability of a false alarm in a whole run is at most that, for any
    success rate and although the tests overlap. While an alarm lasts, the reference is the rate
    before it: a permanent change does not become the reference.
    """

    def __init__(self, total: int) -> None:
        """Begin a run of ``total`` episodes; the number of tests follows from it."""
        tests = max(1, (total - FEWEST_BEFORE - LAST) // EVERY + 1)
        self._level = FALSE_ALARMS / tests
        self._last: deque[bool] = deque()
        self._before = [0, 0]
        """Successes and episodes before the last ones."""
        self._frozen: tuple[int, int] | None = None
        self._made = 0
        self.shift: Shift | None = None

    def add(self, success: bool) -> None:
        """Add the result of an attempt."""
        self._last.append(success)
        self._made += 1
        if len(self._last) > LAST:
            self._before[0] += self._last.popleft()
            self._before[1] += 1
        if self._before[1] >= FEWEST_BEFORE and (self._made - FEWEST_BEFORE - LAST) % EVERY == 0:
            self._test()

    def _test(self) -> None:
        hits, before = sum(self._last), self._frozen or (self._before[0], self._before[1])
        chance = two_sided(hits, LAST, *before)
        if self._frozen is None and chance > self._level:
            return
        if self._frozen is not None and chance > BACK:
            self._before = list(before)  # episodes during the alarm are not part of the reference
            self._frozen = self.shift = None
            return
        self._frozen = before
        self.shift = Shift(before=before[0] / before[1], last=hits / LAST)


def two_sided(hits: int, n: int, hits_before: int, n_before: int) -> float:
    """Return the p-value of two shares of success if both have the same success probability.

    Given the total number of successes, the number among the ``n`` has a hypergeometric
    distribution; the probability of the smaller tail is doubled.
    """
    successes, total = hits + hits_before, n + n_before
    low, high = max(0, successes - n_before), min(n, successes)
    logs = [
        _log_choose(successes, k) + _log_choose(total - successes, n - k)
        for k in range(low, high + 1)
    ]
    whole = _log_choose(total, n)
    weights = [math.exp(value - whole) for value in logs]
    place = hits - low
    return min(1.0, 2.0 * min(math.fsum(weights[: place + 1]), math.fsum(weights[place:])))


def _log_choose(n: int, k: int) -> float:
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
