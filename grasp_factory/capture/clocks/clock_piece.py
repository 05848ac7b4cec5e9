"""A piece of a device's time without jumps: host times at some of its device times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.clocks.clock_rule import NS, ClockRule
from grasp_factory.capture.clocks.jump_detection import FoundStart
from grasp_factory.capture.clocks.lower_hull import ClockLine, LowerHull, Point, line_below
from grasp_factory.signals.timeline import Ticks

_SHORTEST_S = 0.5
"""A piece that is shorter has one line; its drift cannot be seen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockPiece:
    """A piece of a device's time in which its clock did not jump."""

    start: FoundStart
    count: int
    """Samples in it."""
    lines: tuple[ClockLine, ...]
    """The line of each window, at the mean of the window's device times; ascending."""

    @property
    def drift(self) -> float:
        """How much more the host's time grows than the device's, seconds per second."""
        first, last = self.lines[0], self.lines[-1]
        return drift_between(first, last) if last is not first else first.drift

    def host_times(self, device_ns: Ticks) -> Ticks:
        """Return the host times of device times of this piece, ns: linear between the lines."""
        origin = self.lines[0]
        # Differences from the first line are small enough for 64 bit floats to hold them exactly.
        x = np.array([line.device_ns - origin.device_ns for line in self.lines], np.float64)
        y = np.array([line.at(line.device_ns) - line.device_ns for line in self.lines], np.int64)
        at = (device_ns - origin.device_ns).astype(np.float64)
        offset = np.interp(at, x, (y - y[0]).astype(np.float64))
        before, after = self._outer_drifts()
        offset += np.minimum(at - x[0], 0.0) * before + np.maximum(at - x[-1], 0.0) * after
        return np.asarray(device_ns + y[0] + np.round(offset).astype(np.int64))

    def _outer_drifts(self) -> tuple[float, float]:
        if len(self.lines) == 1:
            return self.lines[0].drift, self.lines[0].drift
        return drift_between(*self.lines[:2]), drift_between(*self.lines[-2:])


def drift_between(first: ClockLine, last: ClockLine) -> float:
    """Return the drift from the middle of one window to that of a later one."""
    device = last.device_ns - first.device_ns
    return ((last.host_ns - first.host_ns) - device) / device


def piece_of(start: FoundStart, pairs: Sequence[Point], rule: ClockRule) -> ClockPiece:
    """Return the piece of samples (device and host time, ns): windows of equal length, 2 or more.

    The line of a window is most certain in its middle. So only its value there is used, and the
    drift is that from middle to middle.
    """
    first, duration = pairs[0][0], pairs[-1][0] - pairs[0][0]
    count = max(2, round(duration / (rule.window_s * NS))) if duration > _SHORTEST_S * NS else 1
    length = duration // count + 1
    hulls = [LowerHull() for _ in range(count)]
    for pair in pairs:
        hulls[(pair[0] - first) // length].add(pair)
    lines = tuple(line_below([hull], rule.max_drift) for hull in hulls if hull.count)
    return ClockPiece(start=start, count=len(pairs), lines=lines)
