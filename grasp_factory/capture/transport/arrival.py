"""When the bytes of a stream arrived, although one read brings many."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field


@dataclass(slots=True)
class ArrivalTimes:
    """Knows for each place in a stream when its byte had arrived.

    A read tells only when the last of its bytes was there at the latest. On a serial line of a
    known speed, the bytes before it came earlier, one byte's time each. That bound is used, but
    never a time before the end of the last read, when the byte was not yet there.
    """

    byte_ns: int = 0
    """Shortest time between two bytes, ns; 0 if it is not known."""
    _reads: deque[tuple[int, int, int]] = field(default_factory=deque)
    """End in the stream, time, and time of the read before."""
    _end: int = 0
    _before_ns: int = 0

    def note(self, count: int, host_ns: int) -> None:
        """Note that ``count`` more bytes were there at a time."""
        earliest = self._before_ns or host_ns
        self._end += count
        self._before_ns = host_ns
        self._reads.append((self._end, host_ns, earliest))

    def at(self, end: int) -> int:
        """Return when the byte before a place had arrived, ns; ask in ascending order.

        Raises:
            ValueError: if it has not arrived.
        """
        while self._reads and self._reads[0][0] < end:
            self._reads.popleft()
        if not self._reads:
            raise ValueError(f"byte {end} has not arrived, valid: up to {self._end}")
        last, host_ns, earliest = self._reads[0]
        return max(host_ns - (last - end) * self.byte_ns, min(earliest, host_ns))
