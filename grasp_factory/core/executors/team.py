"""A team of worker processes, each with one pipe and at most one job, and their reports."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from multiprocessing import connection
from typing import Any, NamedTuple

from grasp_factory.core.executors.base import Silence, Task, forever
from grasp_factory.core.executors.worker import LostError, Worker, start_worker

JOBS_PER_PROCESS = 32
"""A worker is replaced after this many jobs: PyBullet's memory grows slowly over resets."""

MOST_UNSTARTED = 3
"""Workers that the system could not start and that are started again: their jobs never began."""

_OVERSLEPT_S = 5.0
"""Seconds of delay after which this process assumes that it and its workers were suspended."""


class Report(NamedTuple):
    """What a worker did."""

    kind: str
    """``message``, ``result``, ``error`` or ``lost``."""
    place: int
    """Number of the job that it is about."""
    value: Any
    """The message, the result, the exception, or in words why the worker is lost."""


class Team:
    """Worker processes that do jobs one by one as they are given."""

    def __init__(
        self,
        task: Task[Any, Any],
        workers: int,
        silence: Silence = forever,
        jobs_per_process: int = JOBS_PER_PROCESS,
        ready: Sequence[Worker] = (),
    ) -> None:
        """Hire workers when there are jobs for them.

        Args:
            task: what they do.
            workers: how many at most, at the same time.
            silence: how long each may be silent.
            jobs_per_process: after so many jobs a worker is replaced.
            ready: workers that were started for this team; ``close`` ends them too.
        """
        self._task, self._silence, self._workers = task, silence, workers
        self._jobs_per_process = jobs_per_process
        self._unstarted = 0
        self._busy: dict[Any, Worker] = {}
        self._idle = list(ready)
        for worker in ready:
            worker.begin(task, silence)

    @property
    def free(self) -> int:
        """Number of jobs that can be given now."""
        return self._workers - len(self._busy)

    def give(self, place: int, job: Any) -> None:
        """Let a worker do a job.

        Args:
            place: its number, by which reports name it.
            job: the job.
        """
        worker = self._alive() or self._hire()
        self._busy[worker.pipe] = worker
        worker.give(place, job)

    def wait(self, *others: Any, wait_s: float = math.inf) -> list[Report]:
        """Return reports of the workers; wait for one, or until another connection has something.

        Args:
            others: connections, with at least one of them if no worker has a job.
            wait_s: seconds after which it returns without any.
        """
        heard = [self._hear(worker) for worker in _wait(self._busy, others, wait_s)]
        return [report for report in heard if report]

    def close(self) -> None:
        """End all workers."""
        workers = [*self._busy.values(), *self._idle]
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.stop()
        self._busy, self._idle = {}, []

    def _alive(self) -> Worker | None:
        """Return an idle worker that still runs, or None; end those that do not."""
        while self._idle:
            worker = self._idle.pop()
            if worker.process.exitcode is None:
                return worker
            worker.stop()
        return None

    def _hire(self) -> Worker:
        worker = start_worker()
        worker.begin(self._task, self._silence)
        return worker

    def _hear(self, worker: Worker) -> Report | None:
        try:
            kind, value = worker.receive()
        except LostError as lost:
            del self._busy[worker.pipe]
            if worker.is_unstarted and self._unstarted < MOST_UNSTARTED:
                self._unstarted += 1
                self.give(worker.place, worker.job)
                return None
            return Report("lost", worker.place, str(lost))
        if kind == "result":
            del self._busy[worker.pipe]
            worker.done += 1
            if worker.done < self._jobs_per_process:
                self._idle.append(worker)
            else:
                worker.stop()
        return Report(kind, worker.place, value)


def _wait(team: dict[Any, Worker], others: Sequence[Any], wait_s: float) -> list[Worker]:
    """Wait, and return the workers that have sent a message or are silent for too long."""
    now = time.monotonic()
    until = min((worker.since + worker.allowed for worker in team.values()), default=math.inf)
    patience = min(max(until - now, 0.0), wait_s)
    ready = connection.wait([*team, *others], None if patience == math.inf else patience)
    if ready:
        return [team[pipe] for pipe in ready if pipe in team]
    overslept = time.monotonic() - now - patience
    if overslept > _OVERSLEPT_S:  # a closed lid, Ctrl-Z: workers were suspended too
        for worker in team.values():
            worker.since = time.monotonic()
    now = time.monotonic()
    return [worker for worker in team.values() if worker.since + worker.allowed <= now]
