"""Worker processes, each with one pipe and at most one job.

The pool is our own. ``concurrent.futures.ProcessPoolExecutor`` hangs on Python 3.11 when it
recycles workers (https://github.com/python/cpython/issues/115634), and breaks as a whole when one
worker dies; so does loky's. Pebble isolates tasks and ends them in time, but it reports nothing of
a task before the task ends: it would not be known which episode of a block killed its worker. Here
there is no shared queue and no helper thread, so a worker that dies cannot leave a lock behind, and
its end of the pipe shows its death at once.
"""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any

from grasp_factory.core.executors.base import (
    Check,
    Executor,
    J,
    R,
    Recover,
    SendMessage,
    Silence,
    Task,
    forever,
    give_up,
    go_on,
)
from grasp_factory.core.executors.serving import serve
from grasp_factory.core.plugins.plugin_sources import allowed
from grasp_factory.errors import WorkerError

JOBS_PER_PROCESS = 32
"""A worker is replaced after this many jobs: PyBullet's memory grows slowly over resets."""

CHECK_S = 0.1
"""Seconds between two calls of an executor's ``check``."""

ONE_THREAD = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLOSC_NTHREADS",
        "OPENCV_FOR_THREADS_NUM",
    )
}
"""Environment variables of workers: the workers already share the cores among themselves."""

_SPAWN = multiprocessing.get_context("spawn")
_POSTPONED = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
_OVERSLEPT_S = 5.0
"""Seconds of delay after which this process assumes that it and its workers were suspended."""


@dataclass(frozen=True, slots=True)
class ProcessExecutor(Executor):
    """Spawned processes; the task, its jobs, messages and results must be picklable."""

    workers: int
    jobs_per_process: int = JOBS_PER_PROCESS
    check: Check = go_on

    def run(
        self,
        task: Task[J, R],
        jobs: Sequence[J],
        report: SendMessage,
        recover: Recover[J] = give_up,
        silence: Silence = forever,
    ) -> list[R]:
        """See ``Executor.run``."""
        todo = list(reversed(list(enumerate(jobs))))
        results: dict[int, R] = {}
        team: dict[Any, _Worker] = {}
        try:
            while todo or team:
                while todo and len(team) < self.workers:
                    _hire(team, task, silence).give(*todo.pop())
                self.check()
                for worker in _wait(team, math.inf if self.check is go_on else CHECK_S):
                    try:
                        kind, value = worker.receive()
                    except _LostError as lost:
                        del team[worker.pipe]
                        todo.append((worker.place, recover(worker.job, str(lost))))
                        continue
                    if kind == "message":
                        report(value)
                        continue
                    if kind == "error":
                        raise value
                    results[worker.place] = value
                    worker.done += 1
                    if todo and worker.done < self.jobs_per_process:
                        worker.give(*todo.pop())
                        continue
                    del team[worker.pipe]
                    worker.stop()
        finally:
            for worker in team.values():
                worker.process.terminate()
            for worker in team.values():
                worker.stop()
        return [results[place] for place in range(len(jobs))]


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
                ' generate() with several workers does so under `if __name__ == "__main__":`'
            )

    def _cause(self) -> str:
        code = self.process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _wait(team: dict[Any, _Worker], longest: float) -> list[_Worker]:
    """Wait, and return the workers that have sent a message or are silent for too long.

    Args:
        team: the workers.
        longest: seconds after which nobody needs to have done so.
    """
    now = time.monotonic()
    patience = min(longest, *(worker.since + worker.allowed - now for worker in team.values()))
    ready = connection.wait(list(team), None if patience == math.inf else max(patience, 0.0))
    if ready:
        return [team[pipe] for pipe in ready]
    overslept = time.monotonic() - now - max(patience, 0.0)
    if overslept > _OVERSLEPT_S:  # a closed lid, Ctrl-Z: workers were suspended too
        for worker in team.values():
            worker.since = time.monotonic()
    now = time.monotonic()
    return [worker for worker in team.values() if worker.since + worker.allowed <= now]


def _hire(team: dict[Any, _Worker], task: Task[Any, Any], silence: Silence) -> _Worker:
    """Start a worker and add it to the team."""
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=serve, args=(task, theirs, allowed()), daemon=True)
    resource_tracker.ensure_running()  # its own start would undo the signal mask
    with _environment(ONE_THREAD), _no_interrupt():
        process.start()
        worker = team[ours] = _Worker(process, ours, silence)
    theirs.close()
    return worker


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables for a while; a child started meanwhile inherits them."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _no_interrupt() -> Iterator[None]:
    """Postpone signals to the end of the block; a child started meanwhile never receives Ctrl-C.

    The child inherits the signal mask. For this process a mask is not enough: another thread, such
    as one of OpenBLAS, may receive the signal, and then Python runs its handler in the main thread
    nevertheless. A child whose start is cut short ends with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        with _handled_later():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _handled_later() -> Iterator[None]:
    """Run Python's signal handlers at the end of the block; they run in the main thread alone."""
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    handlers = {number: signal.getsignal(number) for number in _POSTPONED if is_main}
    ours = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in ours:
            signal.signal(number, lambda number, frame: came.append(number))
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)
        for missed in came:
            signal.raise_signal(missed)
