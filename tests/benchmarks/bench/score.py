"""What a contestant is given, and what it gives back."""

from __future__ import annotations

import resource
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType

WARM_UP_EPISODES = 2
"""Made before the clock starts: imports, file caches and backgrounds are not what is compared."""


class NotAvailable(Exception):
    """A contestant that this installation does not have; the message says why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What every contestant makes: episodes 0 to ``episodes`` - 1, in images of one size."""

    episodes: int
    width: int
    height: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """What came of it in one process."""

    episodes: int
    seconds: float
    cpu_seconds: float
    """Of all threads: above ``seconds`` where more than one core was at work."""
    peak_bytes: int
    """Resident memory of the process at its largest."""
    stored_bytes: int = 0
    details: Mapping[str, float] = field(default_factory=dict)

    @property
    def rate(self) -> float:
        """Episodes per second."""
        return self.episodes / self.seconds


class Stopwatch:
    """Wall and processor time of a ``with`` block."""

    def __enter__(self) -> Stopwatch:
        self._cpu, self._wall = time.process_time(), time.perf_counter()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.seconds = time.perf_counter() - self._wall
        self.cpu_seconds = time.process_time() - self._cpu


def peak_bytes(who: int = resource.RUSAGE_SELF) -> int:
    """Return the largest resident size of this process, or with RUSAGE_CHILDREN of any child."""
    return resource.getrusage(who).ru_maxrss * 1024  # Linux counts in kB
