"""The line below all points that is nearest to them: device time against host time.

A sample arrives late, never early. So the clock's line lies below all points (device time, host
time), and touches those that came fastest. Of all lines below the points, the one with the smallest
sum of distances goes along the edge of the lower convex hull that spans the points' mean (Zhang,
Liu and Xia: Clock Synchronization Algorithms for Network Measurements, INFOCOM 2002).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

Point = tuple[int, int]
"""Device and host time, ns."""


@dataclass(frozen=True, slots=True)
class ClockLine:
    """Host time as a linear function of device time."""

    device_ns: int
    host_ns: int
    """Host time at ``device_ns``."""
    drift: float
    """Seconds that the host's clock gains per second of the device's clock."""

    def at(self, device_ns: int) -> int:
        """Return the host time at a device time, ns."""
        step = device_ns - self.device_ns
        return self.host_ns + step + round(step * self.drift)


class LowerHull:
    """The lower convex hull of points that come in the order of their device time."""

    __slots__ = ("count", "device_sum", "points")

    def __init__(self) -> None:
        self.points: list[Point] = []
        self.count = 0
        self.device_sum = 0

    def add(self, point: Point) -> None:
        """Add a point; its device time is not below that of the points before."""
        self.count += 1
        self.device_sum += point[0]
        _extend(self.points, point)


def _extend(hull: list[Point], point: Point) -> None:
    x, y = point
    if hull and hull[-1][0] == x:  # of equal device times the earliest arrival counts
        if hull[-1][1] <= y:
            return
        hull.pop()
    while len(hull) > 1:
        (x0, y0), (x1, y1) = hull[-2], hull[-1]
        if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
            break
        hull.pop()
    hull.append(point)


def line_below(hulls: Iterable[LowerHull], max_drift: float) -> ClockLine:
    """Return the line below all points of hulls, in order, that is nearest to the points.

    Args:
        hulls: at least one of them with a point.
        max_drift: Largest drift of the line in either direction, seconds per second.
    """
    merged, middle = _merged(hulls)
    return _touching(merged, middle, min(max(_slope_at(merged, middle), -max_drift), max_drift))


def line_of_drift(hulls: Iterable[LowerHull], drift: float) -> ClockLine:
    """Return the line of a known drift that touches the points of hulls from below."""
    return _touching(*_merged(hulls), drift)


def _merged(hulls: Iterable[LowerHull]) -> tuple[list[Point], int]:
    """Return the hull of all points, and their mean device time."""
    merged: list[Point] = []
    count = total = 0
    for hull in hulls:
        count, total = count + hull.count, total + hull.device_sum
        for point in hull.points:
            _extend(merged, point)
    return merged, total // count


def _touching(hull: list[Point], middle: int, drift: float) -> ClockLine:
    x, y = hull[0]
    lowest = min((b - y) - (a - x) * (1.0 + drift) for a, b in hull)
    host = y + (middle - x) + round((middle - x) * drift + lowest)
    return ClockLine(middle, host, drift)


def _slope_at(hull: list[Point], x: int) -> float:
    """Return the slope, minus 1, of the edge that spans ``x``; 0 for a single point."""
    for (x0, y0), (x1, y1) in pairwise(hull):
        if x <= x1:
            return ((y1 - y0) - (x1 - x0)) / (x1 - x0)
    return 0.0
