"""How many messages of a stream are missing, by its stamps alone.

ROS 2 messages have no numbers, and the middleware does not say what it lost. A stream that comes at
a steady rate shows its losses as long steps between stamps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_BIN = math.log(1.01)
"""Steps that differ by less than 1 % are counted together."""
_GAP = 1.5
"""A step that is longer than so many usual ones has a gap."""
_SHORT = 20
"""Steps up to so many usual ones measure the period: how many they span is certain."""
_ROUNDS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class GapCount:
    """What the stamps of a stream say."""

    count: int
    """Messages that came."""
    missing: int
    """Messages that did not come, if the stream has a steady rate."""
    period_ns: float
    """Usual step between stamps; NaN for fewer than two stamps."""
    mean_ns: float
    """Mean step between stamps that are in order; NaN without one."""
    longest_ns: int
    """Longest step; 0 for fewer than two stamps."""
    backward: int
    """Stamps that are not later than the one before."""


class StreamGaps:
    """Counts the steps between the stamps of one stream, in little memory however long it is."""

    def __init__(self) -> None:
        self._count = self._backward = self._longest = 0
        self._last: int | None = None
        self._steps: dict[int, list[int]] = {}

    def add(self, stamp_ns: int) -> None:
        """Add the stamp of the next message."""
        self._count += 1
        if self._last is not None:
            self._add_step(stamp_ns - self._last)
        self._last = stamp_ns

    def _add_step(self, step: int) -> None:
        if step <= 0:
            self._backward += 1
            return
        self._longest = max(self._longest, step)
        found = self._steps.setdefault(int(math.log(step) / _BIN), [0, 0])
        found[0] += 1
        found[1] += step

    def counted(self) -> GapCount:
        """Return the count so far."""
        steps = [(n, length / n) for _, (n, length) in sorted(self._steps.items())]
        period = _period(steps)
        forward = sum(n for n, _ in self._steps.values())
        total = sum(length for _, length in self._steps.values())
        gaps = ((n, mean / period) for n, mean in steps if mean > _GAP * period)
        return GapCount(
            count=self._count,
            missing=sum(n * (round(spanned) - 1) for n, spanned in gaps),
            period_ns=period,
            mean_ns=total / forward if forward else math.nan,
            longest_ns=self._longest,
            backward=self._backward,
        )


def _period(steps: list[tuple[int, float]]) -> float:
    """Return the usual step, from how often each mean step came: the median, then refined."""
    if not steps:
        return math.nan
    middle, seen = sum(n for n, _ in steps) / 2, 0
    for n, mean in steps:
        seen += n
        if seen >= middle:
            period = mean
            break
    for _ in range(_ROUNDS):
        spans = [(n, mean, round(mean / period)) for n, mean in steps]
        used = [(n, mean, span) for n, mean, span in spans if 1 <= span <= _SHORT]
        period = sum(n * mean for n, mean, _ in used) / sum(n * span for n, _, span in used)
    return period
