"""Counts over a run: outcomes per window of episodes, and episodes per interval of time."""

from __future__ import annotations

import itertools
import statistics
from collections import Counter
from typing import Any

MOST_WINDOWS = 120
"""Maximum number in a chart; when there are more, each two adjacent windows become one."""
FEWEST = 5
"""Initial number of episodes in a window: a share of fewer episodes is not reliable."""
TICK_S = 5.0
"""Seconds of an interval in which episodes are counted."""


class Windows:
    """Outcomes of a run in windows of equally many episodes, at most ``MOST_WINDOWS`` of them."""

    def __init__(self) -> None:
        self.size = FEWEST
        """Episodes of a window; the last one may have fewer."""
        self._ends: list[float] = []
        self._counts: list[Counter[str]] = []

    def add(self, outcome: str, at: float) -> None:
        """Count an episode that was made ``at`` seconds after the start."""
        if not self._counts or self._counts[-1].total() == self.size:
            if len(self._counts) == MOST_WINDOWS:
                self._halve()
            self._counts.append(Counter())
            self._ends.append(at)
        self._counts[-1][outcome] += 1
        self._ends[-1] = at

    def to_plain(self) -> dict[str, Any]:
        """Return the windows as lists of equal length, for a chart.

        ``made`` is the number of episodes until each window's end, ``seconds`` the time of that
        end, ``rate`` the window's episodes per second, ``outcomes`` its counts by word, and
        ``success`` the share among episodes that are not quarantined, None if there are none.
        """
        words = sorted(set().union(*self._counts))
        totals = [counts.total() for counts in self._counts]
        made = list(itertools.accumulate(totals))
        spans = [b - a for a, b in itertools.pairwise([0.0, *self._ends])]
        return {
            "size": self.size,
            "made": made,
            "seconds": [round(end, 1) for end in self._ends],
            "rate": [
                round(n / span, 4) if span > 0.0 else None
                for n, span in zip(totals, spans, strict=True)
            ],
            "success": [_share(counts) for counts in self._counts],
            "outcomes": {word: [counts[word] for counts in self._counts] for word in words},
        }

    def _halve(self) -> None:
        pairs = range(0, MOST_WINDOWS, 2)
        self._counts = [self._counts[i] + self._counts[i + 1] for i in pairs]
        self._ends = [self._ends[i + 1] for i in pairs]
        self.size *= 2


class EpisodeRate:
    """The number of episodes in each interval of ``TICK_S`` seconds from the start."""

    def __init__(self) -> None:
        self._ticks: list[int] = []

    def add(self, at: float) -> None:
        """Count an episode that was made ``at`` seconds after the start."""
        self._reach(int(at // TICK_S))
        self._ticks[-1] += 1

    def rates(self, window: float, now: float) -> list[float]:
        """Return episodes per second of each whole window up to ``now``, in order of time.

        Windows are counted back from the last whole interval: the first intervals may be left out.
        """
        self._reach(int(now // TICK_S))
        whole, width = self._ticks[:-1], max(1, round(window / TICK_S))
        first = len(whole) % width
        return [
            sum(whole[i : i + width]) / (width * TICK_S) for i in range(first, len(whole), width)
        ]

    def latest(self, window: float, now: float) -> float:
        """Return episodes per second of the last window, or since the start if that is shorter."""
        self._reach(int(now // TICK_S))
        width = max(1, round(window / TICK_S))
        span = now - max(0, len(self._ticks) - 1 - width) * TICK_S
        return sum(self._ticks[-1 - width :]) / span if span > 0.0 else 0.0

    def _reach(self, tick: int) -> None:
        self._ticks.extend([0] * (tick + 1 - len(self._ticks)))


def median(values: list[float]) -> float:
    """Return the median; 0 if there are no values."""
    return statistics.median(values) if values else 0.0


def _share(counts: Counter[str]) -> float | None:
    attempts = counts.total() - counts["quarantined"]
    return round(counts["success"] / attempts, 4) if attempts else None
