"""When to send each message of a recording that is played at a rate."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from grasp_factory.errors import CaptureError, UsageError, shown

FASTEST = "max"
LONGEST_WAIT_S = 30 * 86_400.0
"""A pause for which nobody waits; a system's sleep has a limit, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayRate:
    """How fast a recording is played: 1 as it was recorded, 0.5 half as fast."""

    factor: float | None = 1.0
    """None to send without waiting."""

    @classmethod
    def parse(cls, text: str) -> PlayRate:
        """Return the rate that a text says: a number, or ``max``.

        Raises:
            UsageError: if it says no rate.
        """
        if text == FASTEST:
            return cls(factor=None)
        try:
            factor = float(text)
        except ValueError:
            factor = 0.0
        if not 1e-3 <= factor <= 1e3:
            raise UsageError(f"--rate: got {shown(text)}, valid: 0.001 to 1000, or {FASTEST}")
        return cls(factor=factor)


class PlayClock:
    """Waits until a message is due.

    Attributes:
        latest_s: how late the latest message was, seconds.
    """

    def __init__(
        self,
        rate: PlayRate,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Begin at the first message.

        Args:
            rate: how fast.
            clock: seconds of a clock that never jumps.
            sleep: waits for seconds.
        """
        self.latest_s = 0.0
        self._rate, self._clock, self._sleep = rate.factor, clock, sleep
        self._first_ns: int | None = None
        self._start = 0.0

    def wait(self, stamp_ns: int) -> None:
        """Wait until the message of a stamp is due; the first one is due at once.

        Raises:
            CaptureError: if that is in more than ``LONGEST_WAIT_S``.
        """
        if self._first_ns is None:
            self._first_ns, self._start = stamp_ns, self._clock()
        if self._rate is None:
            return
        early = self._start + (stamp_ns - self._first_ns) * 1e-9 / self._rate - self._clock()
        if early > LONGEST_WAIT_S:
            days = f"{early / 86_400:,.0f} days"
            raise CaptureError(f"the next message is due in {days}: publish with --rate max")
        if early > 0:
            self._sleep(early)
        else:
            self.latest_s = max(self.latest_s, -early)
