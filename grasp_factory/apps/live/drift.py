"""Whether the success rate has changed in a run: a test that seldom cries wolf."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

LAST = 100
"""Episodes that are compared with all before them."""
FEWEST_BEFORE = 100
EVERY = 20
"""Episodes from a test to the next."""
FALSE_ALARMS = 0.01
"""Chance that a run whose episodes all have one chance of success raises an alarm, at most."""
BACK = 0.05
"""An alarm ends when the last episodes are as likely as this under the rate before it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A change of the success rate, as long as it lasts."""

    before: float
    """Share of successes until ``LAST`` episodes before it was found."""
    last: float
    """Share of the last ``LAST``."""


class SuccessDrift:
    """Compares the last ``LAST`` episodes with all before, every ``EVERY`` episodes.

    Each test is exact (hypergeometric, two-sided), and they share ``FALSE_ALARMS`` equally
    (Bonferroni), so the chance of a false alarm in a whole run is at most that, for any rate of
    success and although the tests overlap. While an alarm lasts, the rate before it stays the
    measure: a change that stays does not become the rule.
    """

    def __init__(self, total: int) -> None:
        """Begin a run of so many episodes; it decides how many tests there are."""
        tests = max(1, (total - FEWEST_BEFORE - LAST) // EVERY + 1)
        self._level = FALSE_ALARMS / tests
        self._last: deque[bool] = deque()
        self._before = [0, 0]
        """Successes and episodes before the last ones."""
        self._frozen: tuple[int, int] | None = None
        self._made = 0
        self.shift: Shift | None = None

    def add(self, success: bool) -> None:
        """Follow an attempt."""
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
            self._before = list(before)  # what came meanwhile is no measure of what is usual
            self._frozen = self.shift = None
            return
        self._frozen = before
        self.shift = Shift(before=before[0] / before[1], last=hits / LAST)


def two_sided(hits: int, n: int, hits_before: int, n_before: int) -> float:
    """Return how likely so uneven shares are if both have one chance of success.

    Given how many successes there are in all, those among the ``n`` are hypergeometric; the
    smaller tail is doubled.
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
