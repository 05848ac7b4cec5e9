"""Sets of samples that belong together, by the rules of ROS's ApproximateTime policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.errors import UsageError
from grasp_factory.signals.timeline import slop_ticks, ticks_of


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeSets:
    """Sets of one sample per series that belong together."""

    indices: Mapping[str, NDArray[np.int64]]
    """(S,) per series: set s has sample ``indices[name][s]``."""
    unmatched: Mapping[str, NDArray[np.int64]]
    """Per series, the samples that are in no set, ascending."""


def approximate_time(
    streams: Mapping[str, ArrayLike], slop: float = float("inf"), age_penalty: float = 0.0
) -> TimeSets:
    """Return the sets that ROS's ApproximateTime policy forms, and the samples that it leaves out.

    This is the C++ policy of message_filters (http://wiki.ros.org/message_filters/ApproximateTime).
    A sample is in one set at most, and sets do not cross. The pivot of a set is the latest of the
    next samples of all series. Of the sets that start no later than the pivot, the policy takes
    the one with the smallest span, and the earliest one of equal spans. rospy's
    ApproximateTimeSynchronizer is different: it takes the first set within the slop, so its result
    depends on the order of arrival.

    All samples are available at once, so no queue overflows. When a series ends, its last set is
    formed; a live node would wait for more samples.

    Args:
        streams: Timestamps (N,) by name, seconds, ascending.
        slop: Longest span of a set, seconds, inclusive: the policy's ``MaxIntervalDuration``.
        age_penalty: A later set must be smaller by this additional factor. ROS's page says 0; the
            default of its C++ code is 0.1.

    Raises:
        UsageError: for times that do not ascend, or no series at all.
    """
    if not streams:
        raise UsageError("approximate_time: no series given, valid: 1 or more")
    ticks = [ticks_of(times, name).tolist() for name, times in streams.items()]
    sets = _approximate_sets(ticks, slop_ticks(slop), age_penalty)
    found = np.array(sets, np.int64).reshape(-1, len(ticks))
    indices = {name: found[:, i] for i, name in enumerate(streams)}
    unmatched = {
        name: np.setdiff1d(np.arange(len(t)), indices[name])
        for name, t in zip(streams, ticks, strict=True)
    }
    return TimeSets(indices=indices, unmatched=unmatched)


def _approximate_sets(
    ticks: list[list[int]], limit: float, age_penalty: float
) -> list[tuple[int, ...]]:
    """Return the sets as indices, one per series.

    ``best`` is the candidate set; without a candidate it is the next sample of each series.
    ``head`` searches beyond it.
    """
    sets: list[tuple[int, ...]] = []
    best = [0] * len(ticks)
    head, pivot, best_start, best_end = best.copy(), -1, 0, 0
    while all(i < len(t) for i, t in zip(head, ticks, strict=True)):
        now = [t[i] for i, t in zip(head, ticks, strict=True)]
        start, end = min(now), max(now)
        first = now.index(start)
        if pivot < 0:
            if end - start > limit:
                head[first] += 1
                best = head.copy()
                continue
            pivot = len(now) - 1 - now[::-1].index(end)
            better = True
        else:
            better = (end - best_end) * (1.0 + age_penalty) < start - best_start
        if better:
            best, best_start, best_end = head.copy(), start, end
        head[first] += 1
        if first == pivot or head[first] == len(ticks[first]):
            sets.append(tuple(best))
            best = [i + 1 for i in best]
            head, pivot = best.copy(), -1
    return sets
