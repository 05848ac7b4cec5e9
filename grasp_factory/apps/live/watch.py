"""The watch of a run: receives its events, reads committed blocks, and makes a snapshot.

The run only puts events into a queue. All else happens in the watch's own thread; an error there is
reported once and does not stop the run.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from grasp_factory.apps.live.alarms import findings
from grasp_factory.apps.live.facts import BlockFacts
from grasp_factory.apps.live.state import Asked, LiveState
from grasp_factory.core.alarm_book import AlarmBook
from grasp_factory.core.serialization import to_plain
from grasp_factory.factory.block_job import LONGEST_REASON, Made

if TYPE_CHECKING:
    from grasp_factory.factory.run_records import RunPlan

STEP_S = 1.0
"""Seconds between two updates of the run's state."""
DISK_S = 10.0
"""Seconds between two measurements of the disk."""
RUNNING, FINISHED, FAILED = "running", "finished", "failed"
"""Phases of a run."""


class RunWatch:
    """Follows one run; ``snapshot`` may be called at any time, by any thread.

    Attributes:
        path: path of the store.
    """

    def __init__(self, plan: RunPlan, tell: Callable[[str], None]) -> None:
        """Prepare to watch the run of a plan; ``begin`` starts.

        Args:
            plan: the plan of the run.
            tell: shows the user a line about an alarm or about a problem of the watch itself.
        """
        self.path = plan.path
        self._plan, self._tell = plan, tell
        self._clock, self._started = time.monotonic(), datetime.now(UTC)
        self._news: SimpleQueue[tuple[float, Made | str]] = SimpleQueue()
        self._state = LiveState(
            Asked(
                to_make=plan.to_make,
                already_there=plan.already_there,
                workers=plan.workers,
                block_size=plan.config.block_size,
                quality=plan.config.quality,
            )
        )
        self._book = AlarmBook()
        self._facts: BlockFacts | None = None
        self._block: int | None = None
        self._disk_at = -DISK_S
        self._has_trouble = False
        self._phase, self._error = RUNNING, ""
        self._is_over = threading.Event()
        self._snapshot = self._summary(0.0)
        self._thread = threading.Thread(target=self._run, name="watch", daemon=True)

    def begin(self) -> None:
        """Start the thread."""
        self._thread.start()

    def episode(self, made: Made) -> None:
        """Receive an episode that was made; this takes the run almost no time."""
        self._news.put((self._now(), made))

    def loss(self, text: str) -> None:
        """Receive the message that a worker was lost."""
        self._news.put((self._now(), text))

    def end(self, phase: str, error: str = "") -> None:
        """Update a last time and end the thread; the snapshot then says how the run ended."""
        self._phase, self._error = phase, error
        self._is_over.set()
        self._thread.join()

    def snapshot(self) -> dict[str, Any]:
        """Return the state of the run as JSON values; docs/guides/live.md describes them."""
        return self._snapshot

    def _run(self) -> None:
        while not self._is_over.wait(STEP_S):
            self._step()
        self._step()

    def _step(self) -> None:
        now = self._now()
        try:
            self._hear()
            self._read(now)
            for alarm in self._book.update(findings(self._state, now), now):
                self._tell(f"alarm ({alarm.kind}): {alarm.text}")
        except Exception as error:  # a failure of the watch must not stop the run
            self._complain(error)
        finally:
            self._snapshot = self._summary(now)

    def _hear(self) -> None:
        while True:
            try:
                at, what = self._news.get_nowait()
            except Empty:
                return
            if isinstance(what, Made):
                self._state.add(what, at)
            else:
                self._state.lose(what, at)

    def _read(self, now: float) -> None:
        """Read the facts of blocks that have been committed, and the images of one episode."""
        if self._facts is None:
            self._facts = BlockFacts(self.path)
        newest = None
        for block, waiting in list(self._state.waiting.items()):
            if not self._facts.committed(waiting):
                continue
            facts = self._facts.read(waiting)
            self._state.commit(block, facts)
            self._block, newest = block, facts[-1].row if facts else newest
        is_first = self._block is not None and not (
            self._state.disk and self._state.disk.per_episode
        )
        if is_first or now - self._disk_at >= DISK_S:
            self._state.disk, self._disk_at = self._facts.disk(self._block), now
        if newest is not None:
            self._state.look(newest, self._facts.images(newest))

    def _complain(self, error: Exception) -> None:
        if not self._has_trouble:
            self._has_trouble = True
            what = f"the live view cannot follow all of the run ({in_a_line(error)})"
            self._tell(f"{what}; the run goes on")

    def _summary(self, now: float) -> dict[str, Any]:
        state, plan = self._state, self._plan
        left = state.seconds_left(now)
        return {
            "live": True,
            "phase": self._phase,
            "error": self._error,
            "path": str(self.path.absolute()),
            "name": self.path.name,
            "episodes": plan.episodes,
            "to_make": plan.to_make,
            "already_there": plan.already_there,
            "workers": plan.workers,
            "shard": str(plan.shard),
            "started": self._started.isoformat(timespec="seconds"),
            "now": (self._started + timedelta(seconds=now)).isoformat(timespec="milliseconds"),
            "elapsed": round(now, 2),
            "made": state.made,
            "quarantined": state.quarantined,
            "success_rate": state.success_rate,
            "rates": {name: round(rate, 4) for name, rate in state.rates(now).items()},
            "seconds_left": None if left is None else round(left, 1),
            "outcomes": dict(state.outcomes.most_common()),
            "windows": state.windows.to_plain(),
            "latest": list(state.latest),
            "waiting": sum(map(len, state.waiting.values())),
            "lost": state.lost,
            "losses": to_plain(list(state.losses)),
            "alarms": [to_plain(alarm) for alarm in self._book.lasting.values()],
            "past_alarms": [to_plain(alarm) for alarm in reversed(self._book.past)],
            "disk": to_plain(state.disk),
        }

    def _now(self) -> float:
        return time.monotonic() - self._clock


def in_a_line(error: Exception) -> str:
    """Return an error's type and text in one line of limited length."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST_REASON]
