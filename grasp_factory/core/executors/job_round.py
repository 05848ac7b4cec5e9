"""The jobs of one call of an executor: which wait, which a team of workers has, what came out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grasp_factory.core.executors.base import J, Recover, SendMessage
from grasp_factory.core.executors.team import Team


class JobRound:
    """Gives jobs to a team and collects their results."""

    def __init__(
        self, team: Team, jobs: Sequence[J], report: SendMessage, recover: Recover[J]
    ) -> None:
        self._team, self._report, self._recover = team, report, recover
        self._todo = list(reversed(list(enumerate(jobs))))
        self._given: dict[int, Any] = {}
        self._results: dict[int, Any] = {}

    @property
    def is_open(self) -> bool:
        """Whether a job waits, or a worker has one."""
        return bool(self._todo or self._given)

    @property
    def results(self) -> list[Any]:
        """The results, in the order of the jobs, once all are there."""
        return [self._results[place] for place in range(len(self._results))]

    def take(self) -> tuple[int, Any] | None:
        """Return a job that waits, with its number, for this process to do; None without one."""
        return self._todo.pop() if self._todo else None

    def keep(self, place: int, result: Any) -> None:
        """Keep the result of a job that ``take`` returned."""
        self._results[place] = result

    def hand_out(self) -> None:
        """Give jobs to the workers that have none."""
        while self._todo and self._team.free:
            place, self._given[place] = job = self._todo.pop()
            self._team.give(*job)

    def hear(self, wait_s: float) -> None:
        """Wait until workers report, for some seconds at most, and take what they report.

        Raises:
            Exception: what a task, or the caller's ``report`` or ``recover``, raised.
        """
        for kind, place, value in self._team.wait(wait_s=wait_s):
            if kind == "message":
                self._report(value)
            elif kind == "error":
                raise value
            elif kind == "lost":
                self._todo.append((place, self._recover(self._given.pop(place), value)))
            else:
                self.keep(place, value)
                del self._given[place]
