"""Playing a recording at the speed at which it was made, or another one."""

from __future__ import annotations

import time
from dataclasses import dataclass
from threading import Event

_NS = 10**9


@dataclass(slots=True)
class Pacer:
    """Waits until a sample is due."""

    speed: float
    """How much faster than it was recorded; 0 for as fast as possible."""
    _first: tuple[int, int] | None = None
    """Recorded and host time of the first sample, ns."""

    def wait(self, recorded_ns: int, stopped: Event) -> None:
        """Wait until a sample of a recorded time is due, or ``stopped`` is set."""
        now = time.monotonic_ns()
        if self._first is None:
            self._first = recorded_ns, now
        if not self.speed:
            return
        recorded, host = self._first
        left = host + (recorded_ns - recorded) / self.speed - now
        if left > 0:
            stopped.wait(left / _NS)
