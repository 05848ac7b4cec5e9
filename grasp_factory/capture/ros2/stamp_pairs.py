"""Pairs of messages of two topics with nearly the same stamp: colour and depth of a camera."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

A = TypeVar("A")
B = TypeVar("B")
_MOST = 64
"""Messages that wait for a partner; the oldest of more has none."""


class StampPairs(Generic[A, B]):
    """Pairs what comes in the order of its stamps.

    Attributes:
        single: what had no partner.
    """

    def __init__(self, tolerance_ns: int) -> None:
        """Begin.

        Args:
            tolerance_ns: largest difference of two stamps; less than half a period.
        """
        self.single = 0
        self._tolerance = tolerance_ns
        self._left: deque[tuple[int, A]] = deque()
        self._right: deque[tuple[int, B]] = deque()

    def add_left(self, stamp_ns: int, item: A) -> list[tuple[A, B]]:
        """Add an item of the first topic; return the pairs that are complete now."""
        self._left.append((stamp_ns, item))
        return self._matched()

    def add_right(self, stamp_ns: int, item: B) -> list[tuple[A, B]]:
        """Add an item of the second topic; return the pairs that are complete now."""
        self._right.append((stamp_ns, item))
        return self._matched()

    def _matched(self) -> list[tuple[A, B]]:
        found = []
        while self._left and self._right:
            difference = self._left[0][0] - self._right[0][0]
            if abs(difference) <= self._tolerance:
                found.append((self._left.popleft()[1], self._right.popleft()[1]))
            elif difference < 0:
                self._left.popleft()
                self.single += 1
            else:
                self._right.popleft()
                self.single += 1
        if len(self._left) > _MOST:
            self._left.popleft()
            self.single += 1
        if len(self._right) > _MOST:
            self._right.popleft()
            self.single += 1
        return found
