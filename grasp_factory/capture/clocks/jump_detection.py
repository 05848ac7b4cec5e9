"""Where a device's clock jumped or wrapped: there a new piece of its time begins."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

from grasp_factory.capture.clocks.clock_rule import NS, ClockRule


class PieceStart(Enum):
    """Why a piece begins."""

    FIRST_SAMPLE = 0
    BACKWARD = 1
    """The device's time is below that of the sample before: a wrap, a restart, or a jump."""
    AHEAD = 2
    """The device's clock jumped forward: a sample came earlier than any delay allows."""
    BEHIND = 3
    """The device's clock lost time: all samples stay later than before."""


@dataclass(frozen=True, slots=True)
class FoundStart:
    """The beginning of a piece."""

    index: int
    """Number of its first sample in the stream."""
    reason: PieceStart


@dataclass(slots=True)
class _Raised:
    """Samples that came late, so far without one that did not."""

    index: int
    host_ns: int


class JumpDetector:
    """Finds the pieces in a stream of pairs of device and host time.

    The offset, host minus device, is the clocks' difference plus a delay. Its lowest value of the
    last seconds is the reference. A sample below it shows a jump at once. Samples above it show one
    only when they stay there; a busy host makes samples late for a shorter time.
    """

    def __init__(self, rule: ClockRule) -> None:
        self._rule = rule
        self._count = 0
        self._last_device_ns = 0
        self._lowest: deque[tuple[int, int]] = deque()
        """Host time and offset of the lowest samples, ascending in both; the first is lowest."""
        self._raised: _Raised | None = None

    def add(self, device_ns: int, host_ns: int) -> FoundStart | None:
        """Take a sample, and return the start of a piece if this sample shows one.

        It may be a sample that came before this one.
        """
        index, self._count = self._count, self._count + 1
        offset = host_ns - device_ns
        is_backward = device_ns < self._last_device_ns
        self._last_device_ns = device_ns
        if index == 0:
            return self._begin(index, PieceStart.FIRST_SAMPLE, host_ns, offset)
        if is_backward:
            return self._begin(index, PieceStart.BACKWARD, host_ns, offset)
        since, lowest = self._lowest[0]
        tolerance = self._rule.jump_s * NS + self._rule.max_drift * (host_ns - since)
        if offset < lowest - tolerance:
            return self._begin(index, PieceStart.AHEAD, host_ns, offset)
        if offset <= lowest + tolerance:
            self._raised = None
            self._keep(host_ns, offset)
            return None
        return self._late(index, host_ns, offset)

    def _late(self, index: int, host_ns: int, offset: int) -> FoundStart | None:
        if self._raised is None:
            self._raised = _Raised(index, host_ns)
        raised = self._raised
        if host_ns - raised.host_ns < self._rule.confirm_s * NS:
            return None
        return self._begin(raised.index, PieceStart.BEHIND, host_ns, offset)

    def _begin(self, index: int, reason: PieceStart, host_ns: int, offset: int) -> FoundStart:
        self._lowest.clear()
        self._raised = None
        self._keep(host_ns, offset)
        return FoundStart(index, reason)

    def _keep(self, host_ns: int, offset: int) -> None:
        while self._lowest and self._lowest[-1][1] >= offset:
            self._lowest.pop()
        self._lowest.append((host_ns, offset))
        oldest = host_ns - self._rule.confirm_s * NS
        while len(self._lowest) > 1 and self._lowest[0][0] < oldest:
            self._lowest.popleft()
