"""One worker process: it is started, told a task, and given jobs one by one."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnProcess
from typing import Any

from grasp_factory.core.executors.base import Silence, Task, forever
from grasp_factory.core.executors.process_start import (
    OF_A_WORKER,
    check_main_guard,
    environment,
    no_interrupt,
    without_lost_script,
)
from grasp_factory.core.executors.serving import serve
from grasp_factory.core.plugins.plugin_sources import allowed
from grasp_factory.errors import WorkerError

_NOT_STARTED = 255
"""Exit code of a process that could not become a Python."""
_SPAWN = multiprocessing.get_context("spawn")


class LostError(Exception):
    """A worker died or was silent for too long; the text says which."""


@dataclass(slots=True)
class Worker:
    """A process with one pipe and at most one job."""

    process: SpawnProcess
    pipe: connection.Connection[Any, Any]
    silence: Silence = forever
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

    def begin(self, task: Task[Any, Any], silence: Silence) -> None:
        """Tell it the task of all its jobs.

        Args:
            task: what it does.
            silence: how long it may be silent.
        """
        self.silence = silence
        with contextlib.suppress(OSError):  # it died: the first job's receive reports that
            self.pipe.send(task)

    def give(self, place: int, job: Any) -> None:
        """Let it do a job.

        Args:
            place: its number, by which reports name it.
            job: the job.
        """
        self.place, self.job = place, job
        self._listen(None)
        with contextlib.suppress(OSError):  # it died: the next receive reports that
            self.pipe.send(job)

    def receive(self) -> tuple[str, Any]:
        """Return the kind and the content of its message.

        Call this when there is one, or its time is over.

        Raises:
            LostError: if it is dead, or silent for too long.
        """
        if not self.pipe.poll():
            self.process.kill()  # it may be stopped, or stuck where no other signal reaches it
            self.stop()
            raise LostError(f"silent for more than {self.allowed:g} s")
        try:
            kind, value = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(timeout=5.0)  # it may still be ending
            self.stop()
            self._check_guard()
            raise LostError(self._cause()) from None
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
                "a worker ended (exit code 1) before it began: see above why; a script that starts"
                ' workers does so under `if __name__ == "__main__":`'
            ) from None

    def _cause(self) -> str:
        code = self.process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def start_worker(imports: Sequence[str] = ()) -> Worker:
    """Start a worker process, which waits for its task.

    Args:
        imports: modules that it imports meanwhile.

    Raises:
        WorkerError: in a process that cannot start any.
    """
    _check_start()
    ours, theirs = _SPAWN.Pipe()
    process = _SPAWN.Process(target=serve, args=(theirs, allowed(), imports), daemon=True)
    with environment(OF_A_WORKER), without_lost_script():
        resource_tracker.ensure_running()  # its own start would undo the signal mask
        with no_interrupt():
            process.start()
    theirs.close()
    return Worker(process, ours)


def _check_start() -> None:
    check_main_guard()
    if multiprocessing.current_process().daemon:
        raise WorkerError(
            "this process is a daemon of multiprocessing, which can start no workers: use workers=1"
            " in it"
        )
    try:
        os.getcwd()
    except FileNotFoundError:
        raise WorkerError("the current folder was deleted: change to another one") from None


@contextlib.contextmanager
def early_workers(number: int, imports: Sequence[str]) -> Iterator[Sequence[Worker]]:
    """Start workers that import modules while this process does so too; end them after the block.

    There may be fewer jobs than workers, so there is one for each other core at most.

    Args:
        number: how many at most.
        imports: modules that their task needs, because the import is most of their start.
    """
    others = max(1, len(os.sched_getaffinity(0)) - 1)
    workers = [start_worker(imports) for _ in range(min(number, others))]
    try:
        yield workers
    finally:
        for worker in workers:
            worker.stop()
