"""The state of a run so far, as a few numbers even for a long run."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from grasp_factory.apps.live.drift import Shift, SuccessDrift
from grasp_factory.apps.live.facts import Brightness, Disk, EpisodeFacts
from grasp_factory.apps.live.windows import EpisodeRate, Windows
from grasp_factory.factory.block_job import Made
from grasp_factory.labels.quality import QualityConfig

LATEST = 24
"""Number of latest episodes that the page shows."""
RECENT = 50
"""Number of latest episodes whose facts the alarms check."""
MINUTE_S = 60.0
QUARANTINED = "quarantined"


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """The part of a run's request that its watch needs."""

    to_make: int
    already_there: int = 0
    workers: int = 1
    block_size: int = 8
    quality: QualityConfig = field(default_factory=QualityConfig)


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveMessage:
    """A message for the user and its time, in seconds after the start."""

    at: float
    text: str


class LiveState:
    """The state of a run. Times are seconds after its start; nothing here reads a clock.

    Attributes:
        asked: what the run was asked to do.
        made: number of episodes so far, including quarantined ones.
        outcomes: number of episodes by outcome, including ``quarantined``.
        latest_at: when the last episode was made; None before the first.
        windows: outcomes over time.
        pace: episodes over time.
        recent: whether each of the last ``RECENT`` episodes is quarantined.
        facts: facts of the last ``RECENT`` episodes that are committed.
        latest: the last ``LATEST`` rows that are in the store, newest first.
        waiting: episodes that were made, by block, of blocks that are not committed yet.
        losses: the last messages about lost workers.
        disk: the free disk space; None before it is measured.
    """

    def __init__(self, asked: Asked) -> None:
        self.asked = asked
        self.made = 0
        self.outcomes: Counter[str] = Counter()
        self.latest_at: float | None = None
        self.windows, self.pace = Windows(), EpisodeRate()
        self.recent: deque[bool] = deque(maxlen=RECENT)
        self.facts: deque[EpisodeFacts] = deque(maxlen=RECENT)
        self.latest: deque[dict[str, Any]] = deque(maxlen=LATEST)
        self.waiting: dict[int, list[Made]] = {}
        self.losses: deque[LiveMessage] = deque(maxlen=LATEST)
        self.lost = 0
        self.disk: Disk | None = None
        self._drift = SuccessDrift(asked.to_make)

    @property
    def quarantined(self) -> int:
        """Number of quarantined episodes of this run."""
        return self.outcomes[QUARANTINED]

    @property
    def success_rate(self) -> float | None:
        """Share of successes among the attempts; None before the first."""
        attempts = self.made - self.quarantined
        return self.outcomes["success"] / attempts if attempts else None

    @property
    def left(self) -> int:
        """Number of episodes that are still to be made."""
        return max(0, self.asked.to_make - self.made)

    @property
    def shift(self) -> Shift | None:
        """The current change of the success rate, if there is one."""
        return self._drift.shift

    def add(self, made: Made, at: float) -> None:
        """Add an episode that was made; its block is not committed yet."""
        self.made += 1
        self.outcomes[made.outcome] += 1
        self.latest_at = at
        self.windows.add(made.outcome, at)
        self.pace.add(at)
        self.recent.append(made.outcome == QUARANTINED)
        if made.outcome != QUARANTINED:
            self._drift.add(made.outcome == "success")
        self.waiting.setdefault(made.index // self.asked.block_size, []).append(made)

    def lose(self, text: str, at: float) -> None:
        """Add the loss of a worker."""
        self.lost += 1
        self.losses.append(LiveMessage(at=at, text=text))

    def commit(self, block: int, facts: Iterable[EpisodeFacts]) -> None:
        """Add the commit of a block, with the facts of its episodes."""
        found = {fact.row: fact for fact in facts}
        for made in self.waiting.pop(block):
            fact = found.get(made.index)
            self.latest.appendleft(_entry(made, fact))
            if fact is not None:
                self.facts.append(fact)

    def look(self, row: int, images: dict[str, Brightness]) -> None:
        """Add the brightness of an episode's images to its facts, if these are still kept."""
        for place, fact in enumerate(self.facts):
            if fact.row == row:
                self.facts[place] = replace(fact, images=images)

    def rates(self, now: float) -> dict[str, float]:
        """Return episodes per second of the last minute and of the whole run."""
        whole = self.made / now if now > 0.0 else 0.0
        return {"minute": self.pace.latest(MINUTE_S, now), "run": whole}

    def seconds_left(self, now: float) -> float | None:
        """Return the time for the rest at the last minute's rate, s; None if that rate is 0."""
        rate = self.rates(now)["minute"]
        return self.left / rate if rate > 0.0 else None


def _entry(made: Made, fact: EpisodeFacts | None) -> dict[str, Any]:
    """Return what the page shows of an episode that is in the store."""
    return {
        "row": made.index,
        "outcome": made.outcome,
        "policy": made.policy,
        "error": made.reason,
        "object_id": fact.object_id if fact else "",
        "quality": fact.quality if fact else None,
        "version": fact.version if fact else "",
    }
