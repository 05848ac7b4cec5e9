"""Where jobs run: in this process, or in worker processes that each own whole jobs."""

from __future__ import annotations

from grasp_factory.core.executors.base import (
    Check,
    Executor,
    InlineExecutor,
    Recover,
    SendMessage,
    Silence,
    Task,
    go_on,
)
from grasp_factory.core.executors.limited import LimitedExecutor, ProcessLimits
from grasp_factory.core.executors.pool import JOBS_PER_PROCESS, ProcessExecutor

__all__ = [
    "JOBS_PER_PROCESS",
    "Check",
    "Executor",
    "InlineExecutor",
    "LimitedExecutor",
    "ProcessExecutor",
    "ProcessLimits",
    "Recover",
    "SendMessage",
    "Silence",
    "Task",
    "go_on",
    "make_executor",
]


def make_executor(workers: int, jobs_per_process: int = JOBS_PER_PROCESS) -> Executor:
    """Return the executor for a number of workers; one worker needs no pool."""
    return InlineExecutor() if workers == 1 else ProcessExecutor(workers, jobs_per_process)
