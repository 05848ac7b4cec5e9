"""Alarms over time: what is wrong now, since when, and what was reported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

AGAIN_S = 600.0
"""Minimum seconds between two reports of the same kind of alarm."""
MOST_PAST = 20
"""Maximum number of ended alarms that are kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A problem that exists at this moment."""

    kind: str
    text: str
    rows: tuple[int, ...] = ()
    """Rows of the latest episodes that show it, ascending."""
    source: str = ""
    """The device that has it; empty if it is no device's."""

    @property
    def key(self) -> str:
        """What tells it from others that exist at the same time."""
        return f"{self.source} {self.kind}".strip()


@dataclass(frozen=True, slots=True, kw_only=True)
class Alarm:
    """A finding over the time that it lasts; times are seconds after the run's start."""

    kind: str
    since: float
    text: str
    rows: tuple[int, ...] = ()
    until: float | None = None
    """When its cause ended; None while it lasts."""
    source: str = ""


class AlarmBook:
    """Keeps when alarms began and ended, and when they were reported."""

    def __init__(self) -> None:
        self.lasting: dict[str, Alarm] = {}
        """Current alarms by ``Finding.key``, in the order of the findings."""
        self.past: list[Alarm] = []
        """The last alarms that ended, oldest first."""
        self._told: dict[str, float] = {}

    def update(self, found: Iterable[Finding], now: float) -> list[Alarm]:
        """Update the alarms from the current findings; return those to report to the user."""
        before, self.lasting = self.lasting, {}
        for one in found:
            since = before[one.key].since if one.key in before else now
            self.lasting[one.key] = Alarm(
                kind=one.kind, since=since, text=one.text, rows=one.rows, source=one.source
            )
        ended = [alarm for key, alarm in before.items() if key not in self.lasting]
        self.past = [*self.past, *(replace(a, until=now) for a in ended)][-MOST_PAST:]
        new = {key: alarm for key, alarm in self.lasting.items() if key not in before}
        fresh = {k: a for k, a in new.items() if now - self._told.get(k, -AGAIN_S) >= AGAIN_S}
        self._told.update(dict.fromkeys(fresh, now))
        return list(fresh.values())
