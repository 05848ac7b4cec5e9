"""Progress on stderr: a bar in a terminal or a notebook, and a line a minute elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from tqdm import tqdm  # type: ignore[import-untyped]

from grasp_factory.core.text_format import count, duration_text, escaped

LINE_S = 60.0
"""Shortest time between two lines, seconds."""


class _Bar(tqdm):  # type: ignore[misc]
    monitor_interval = 0  # without tqdm's thread, signals and worker processes stay simple


def has_bars() -> bool:
    """Return whether stderr shows bars: it is a terminal, or the output of a notebook's cell."""
    return sys.stderr.isatty() or type(sys.stderr).__module__.startswith("ipykernel.")


def write_line(text: str) -> None:
    """Print a line on stderr, above the bar if there is one."""
    tqdm.write(escaped(text), file=sys.stderr)


class Progress:
    """Counts what is done, and shows it on stderr while that takes longer than a minute."""

    def __init__(
        self,
        total: int,
        unit: str,
        *,
        bar_format: str | None = None,
        leave: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Show a bar at once where stderr has bars.

        Args:
            total: number of things to do; 0 if it is not known.
            unit: one of them, or ``%``.
            bar_format: the bar's format, as of tqdm.
            leave: whether the bar stays at its end.
            clock: returns seconds.
        """
        self._total, self._unit, self._clock = total, unit, clock
        self._done, self._start = 0, clock()
        self._next = self._start + LINE_S
        self._bar: _Bar | None = None
        if has_bars():
            self._bar = _Bar(
                total=total, unit=unit, leave=leave, dynamic_ncols=True, bar_format=bar_format
            )

    def count(self, note: str = "") -> None:
        """Advance by one; ``note`` stands behind the numbers."""
        self._done += 1
        if self._bar is not None:
            if note:
                self._bar.set_postfix_str(note, refresh=False)
            self._bar.update()
        elif (now := self._clock()) >= self._next:
            self._next = now + LINE_S
            write_line(self._line(now - self._start, note))

    def _line(self, seconds: float, note: str) -> str:
        parts = [f"{self._amount()} after {duration_text(seconds)}"]
        if self._total > self._done:
            left = seconds / self._done * (self._total - self._done)
            parts.append(f"about {duration_text(left)} left")
        return ", ".join([*parts, *([note] if note else [])])

    def _amount(self) -> str:
        if self._unit == "%":
            return f"{self._done} %"
        if not self._total:
            return count(self._done, self._unit)
        return f"{self._done} of {count(self._total, self._unit)}"

    def close(self) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bar."""
        self.close()
