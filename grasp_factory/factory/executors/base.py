"""What every executor does, and the one that needs no other process."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from grasp_factory.errors import WorkerError

J = TypeVar("J")
R = TypeVar("R")
SendMessage = Callable[[Any], None]
Task = Callable[[J, SendMessage], R]
"""``task(job, report)`` does a job; it may call ``report(message)`` while it does."""
Recover = Callable[[J, str], J]
"""``recover(job, why)`` returns what to do in place of a job whose worker is lost, or raises."""
Silence = Callable[[Any], float]
"""``silence(message)`` returns for how many seconds a worker may say nothing after a message.

The message is None when it begins a job. A worker that says nothing for longer is lost."""


def give_up(job: Any, why: str) -> Any:
    """Recover from nothing.

    Raises:
        WorkerError: always.
    """
    raise WorkerError(
        f"a worker was lost in {job} ({why}); what is finished stays: run the same command again"
        " to go on"
    )


def forever(message: Any) -> float:
    """Let a worker be silent for as long as it likes."""
    return math.inf


class Executor(ABC):
    """Runs a task on jobs. To add one, implement ``run``."""

    @abstractmethod
    def run(
        self,
        task: Task[J, R],
        jobs: Sequence[J],
        report: SendMessage,
        recover: Recover[J] = give_up,
        silence: Silence = forever,
    ) -> list[R]:
        """Run ``task`` once on each job and return the results in the order of ``jobs``.

        Each message of a task reaches ``report`` in this process, in the task's order. When the
        call ends, by whatever way, nothing of it runs any more.

        Args:
            task: what to do.
            jobs: on what.
            report: hears the tasks' messages.
            recover: asked what to do instead when a worker process dies, or is silent too long.
            silence: how long that is.

        Raises:
            WorkerError: if a worker process is lost, unless ``recover`` knows better. An exception
                of the task is raised as it is.
        """


class InlineExecutor(Executor):
    """One job after the other, in this process: what kills it, kills all."""

    def run(
        self,
        task: Task[J, R],
        jobs: Sequence[J],
        report: SendMessage,
        recover: Recover[J] = give_up,
        silence: Silence = forever,
    ) -> list[R]:
        """See ``Executor.run``."""
        return [task(job, report) for job in jobs]
