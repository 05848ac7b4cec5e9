"""The fit of a device's clock to the host's while it records."""

from __future__ import annotations

from grasp_factory.capture.clocks.clock_piece import drift_between
from grasp_factory.capture.clocks.clock_rule import NS, ClockRule
from grasp_factory.capture.clocks.jump_detection import JumpDetector
from grasp_factory.capture.clocks.lower_hull import (
    ClockLine,
    LowerHull,
    line_below,
    line_of_drift,
)

_WINDOWS = 4
"""Windows that the line of the present follows."""


class ClockTracker:
    """Follows a device's clock sample by sample.

    A jump that only makes samples later shows after ``ClockRule.confirm_s``. Until then the times
    of the samples follow the old line. ``fit_clock`` has no such delay.
    """

    def __init__(self, rule: ClockRule | None = None) -> None:
        self._rule = rule or ClockRule()
        self._detector = JumpDetector(self._rule)
        self._length = int(self._rule.window_s * NS)
        self._hulls: list[LowerHull] = []
        self._middles: list[ClockLine] = []
        """The lines of the windows that are complete."""
        self._until = 0
        self.pieces = 0
        """Pieces so far: one more than jumps."""

    def add(self, device_ns: int, host_ns: int) -> int:
        """Take a sample, and return when it was taken, on the host's clock, ns."""
        if self._detector.add(device_ns, host_ns) is not None:
            self.pieces += 1
            self._hulls, self._middles = [], []
        if not self._hulls or device_ns >= self._until:
            self._next_window(device_ns)
        self._hulls[-1].add((device_ns, host_ns))
        return self._line().at(device_ns) - round(self._rule.latency_s * NS)

    @property
    def drift_ppm(self) -> float:
        """The present drift, parts per million; 0 without samples."""
        return self._line().drift * 1e6 if self._hulls else 0.0

    def _next_window(self, device_ns: int) -> None:
        if self._hulls:
            self._middles.append(line_below(self._hulls[-1:], self._rule.max_drift))
        self._hulls = [*self._hulls[-_WINDOWS + 1 :], LowerHull()]
        self._middles = self._middles[-_WINDOWS:]
        self._until = device_ns + self._length

    def _line(self) -> ClockLine:
        if len(self._middles) < 2:
            return line_below(self._hulls, self._rule.max_drift)
        limit = self._rule.max_drift
        drift = drift_between(self._middles[0], self._middles[-1])
        return line_of_drift(self._hulls, min(max(drift, -limit), limit))
