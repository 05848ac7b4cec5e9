"""A team of worker processes, each with one pipe and at most one job, and their reports."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple

from grasp_factory.core.executors.base import Silence, Task, forever
from grasp_factory.core.executors.process_start import ONE_THREAD, environment, no_interrupt
from grasp_factory.core.executors.serving import serve
from grasp_factory.core.plugins.plugin_sources import allowed
from grasp_factory.errors import WorkerError

JOBS_PER_PROCESS = 32
"""A worker is replaced after this many jobs: PyBullet's memory grows slowly over resets."""

MOST_UNSTARTED = 3
"""Workers that the system could not start and that are started again: their jobs never began."""

_NOT_STARTED = 255
"""Exit code of a process that could not become a Python."""
_SPAWN = multiprocessing.get_context("spawn")
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
    ) -> None:
        self._task, self._silence, self._workers = task, silence, workers
        self._jobs_per_process = jobs_per_process
        self._unstarted = 0
        self._busy: dict[Any, _Worker] = {}
        self._idle: list[_Worker] = []

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
        worker = self._idle.pop() if self._idle else _hire(self._task, self._silence)
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

    def _hear(self, worker: _Worker) -> Report | None:
        try:
            kind, value = worker.receive()
        except _LostError as lost:
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


class _LostError(Exception):
    """A worker died or was silent for too long; the text says which."""


@dataclass(slots=True)
class _Worker:
    process: SpawnProcess
    pipe: connection.Connection[Any, Any]
    silence: Silence
    place: int = -1
    """Position of its job among all jobs."""
    job: Any = None
    done: int = 0
    """Jobs that it has finished."""
    heard: bool = False
    """Whether it has sent something, so that it is known to have started."""
    allowed: float = math.inf
    """Seconds that it may be silent."""
    since: float = 0.0
    """When it was last heard, on the monotonic clock."""

    @property
    def is_unstarted(self) -> bool:
        """Whether the system could not start its process."""
        return not self.heard and self.process.exitcode == _NOT_STARTED

    def give(self, place: int, job: Any) -> None:
        self.place, self.job = place, job
        self._listen(None)
        with contextlib.suppress(OSError):  # it died: the next receive reports that
            self.pipe.send(job)

    def receive(self) -> tuple[str, Any]:
        """Return the worker's message; call this when there is one, or its time is over."""
        if not self.pipe.poll():
            self.process.kill()  # it may be stopped, or stuck where no other signal reaches it
            self.stop()
            raise _LostError(f"silent for more than {self.allowed:g} s")
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(timeout=5.0)  # it may still be ending
            self.stop()
            self._check_guard()
            raise _LostError(self._cause()) from None
        self.heard = True
        self._listen(value)
        return kind, value

    def stop(self) -> None:
        """End the process; between jobs nothing is lost, and an unfinished job is done again."""
        if not self.heard:  # it is starting, and would not react to SIGTERM
            self.process.kill()
        self.process.terminate()
        self.process.join(timeout=3.0)  # time to tidy its temporary files
        self.process.kill()
        self.process.join()
        self.pipe.close()

    def _listen(self, message: Any) -> None:
        self.allowed, self.since = self.silence(message), time.monotonic()

    def _check_guard(self) -> None:
        if not self.heard and self.process.exitcode == 1:
            raise WorkerError(
                "a worker ended (exit code 1) before it began: see above why; a script that calls"
                ' generate() does so under `if __name__ == "__main__":`'
            ) from None

    def _cause(self) -> str:
        code = self.process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _wait(team: dict[Any, _Worker], others: Sequence[Any], wait_s: float) -> list[_Worker]:
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


def _hire(task: Task[Any, Any], silence: Silence) -> _Worker:
    """Start a worker."""
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=serve, args=(task, theirs, allowed()), daemon=True)
    resource_tracker.ensure_running()  # its own start would undo the signal mask
    with environment(ONE_THREAD), no_interrupt():
        process.start()
    theirs.close()
    return _Worker(process, ours, silence)
