"""Limits of memory and time for a task that does what a stranger's file says.

A recipe whose values are all valid may still ask for more than a machine has. The task runs in a
worker process, so that an abort of the physics engine or of a decoder ends the worker alone.
"""

from __future__ import annotations

import resource
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

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
from grasp_factory.core.executors.pool import ProcessExecutor
from grasp_factory.core.limits import CHUNK, CPU, MEMORY, Limit
from grasp_factory.core.os_errors import NO_THREAD
from grasp_factory.core.text_format import size_text
from grasp_factory.errors import LimitError

GRACE_S = 2.0
"""Processor time beyond a job's limit after which the kernel ends the process, s: a library that
does not return to Python cannot be interrupted otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessLimits:
    """How much a worker process may use."""

    what: str
    """What it does, the subject of a message."""
    memory: Limit
    cpu: Limit
    """Processor time of each job, s."""
    file: Limit
    """Bytes of each file that it writes."""

    @property
    def time_error(self) -> LimitError:
        """The error of a job that needs more processor time."""
        return LimitError(f"{self.what} takes more than {self.cpu.most} s; {self.cpu.advice}")


SIMULATION = ProcessLimits(what="the simulation", memory=MEMORY, cpu=CPU, file=CHUNK)


@dataclass(frozen=True, slots=True)
class LimitedExecutor(Executor):
    """Runs a task in worker processes with limits."""

    workers: int
    limits: ProcessLimits = SIMULATION
    check: Check = go_on

    def run(
        self,
        task: Task[J, R],
        jobs: Sequence[J],
        report: SendMessage,
        recover: Recover[J] = give_up,
        silence: Silence = forever,
        *,
        check_node: Callable[[], None] = go_on,
    ) -> list[R]:
        """See ``Executor.run``.

        Raises:
            LimitError: if a job needs more memory or time than the limits allow.
        """

        def lost(job: J, why: str) -> J:
            if signal.SIGPROF.name in why:
                raise self.limits.time_error
            return recover(job, why)

        executor = ProcessExecutor(self.workers, check=self.check)
        return executor.run(Limited(task, self.limits), jobs, report, lost, silence)


@dataclass(frozen=True, slots=True)
class Limited:
    """A task that limits the process it runs in: memory, CPU time of each job, size of files."""

    task: Task[Any, Any]
    limits: ProcessLimits

    def __call__(self, job: Any, report: SendMessage) -> Any:
        """Do a job.

        Raises:
            LimitError: if it needs more memory or time. If it cannot be interrupted, the process
                ends by ``SIGPROF``.
        """
        memory, cpu = self.limits.memory, self.limits.cpu
        _set(resource.RLIMIT_DATA, _used_memory() + memory.most)
        _set(resource.RLIMIT_FSIZE, self.limits.file.most)
        _set(resource.RLIMIT_CORE, 0)
        signal.signal(signal.SIGXCPU, self._stop)
        used = resource.getrusage(resource.RUSAGE_SELF)
        _set(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + cpu.most)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, cpu.most + GRACE_S)
        try:
            return self.task(job, report)
        except (MemoryError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and str(error) != NO_THREAD:
                raise
            most = size_text(memory.most)
            raise LimitError(
                f"{self.limits.what} needs more than {most} of memory; {memory.advice}"
            ) from None
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            _set(resource.RLIMIT_CPU, resource.RLIM_INFINITY)

    def _stop(self, number: int, frame: FrameType | None) -> NoReturn:
        raise self.limits.time_error


@cache
def _used_memory() -> int:
    """Return the bytes that the process has reserved before its first job.

    Libraries reserve some for each processor core. 0 where the system does not tell.
    """
    try:
        pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[5]
    except OSError:
        return 0
    return int(pages) * resource.getpagesize()


def _set(which: int, most: int) -> None:
    """Set a limit, but none that is higher than the process may set."""
    highest = resource.getrlimit(which)[1]
    if highest != resource.RLIM_INFINITY and not 0 <= most <= highest:
        most = highest
    resource.setrlimit(which, (most, highest))
