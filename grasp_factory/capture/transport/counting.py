"""A device's own count of its samples: unwrapped, and what it says was lost."""

from __future__ import annotations

from dataclasses import dataclass


def signed_step(before: int, after: int, bits: int) -> int:
    """Return the shortest way from one value of a counter that wraps at 2**bits to another."""
    half = 1 << (bits - 1)
    return (after - before + half) % (1 << bits) - half


@dataclass(slots=True)
class UnwrappedClock:
    """A device's clock that begins again at 0 after 2**bits - 1, without end."""

    bits: int
    _last: int | None = None

    def unwrap(self, raw: int) -> int:
        """Return the time that is nearest to the one before; the first is taken as it is."""
        self._last = raw if self._last is None else self._last + self._step(raw, self._last)
        return self._last

    def _step(self, raw: int, last: int) -> int:
        return signed_step(last, raw, self.bits)


_MOST_LATE = 16
"""After so many late samples in a row, the device must have started its count again."""


@dataclass(slots=True)
class SampleCount:
    """The numbers of a device's samples in order, and how many of them did not come."""

    bits: int
    lost: int = 0
    late: int = 0
    """Samples that came twice, or after a later one. They stay counted as lost."""
    _raw: int | None = None
    """The last number as the device sent it; None at the beginning of a stream."""
    _last: int | None = None
    _late_in_a_row: int = 0

    def number(self, raw: int) -> int | None:
        """Return the unwrapped number of a sample, which ascends; None if it comes too late."""
        if self._raw is None:
            step = 1
            self._last = raw if self._last is None else self._last + step
        else:
            step = signed_step(self._raw, raw, self.bits)
            if step <= 0 and self._late_in_a_row < _MOST_LATE:
                self.late += 1
                self._late_in_a_row += 1
                return None
            step = step if step > 0 else 1
            assert self._last is not None
            self._last += step
        self._raw, self._late_in_a_row = raw, 0
        self.lost += step - 1
        return self._last

    def restart(self) -> None:
        """Begin a new stream: the device starts its count again, and the numbers go on.

        What was lost between both streams is not known.
        """
        self._raw = None
