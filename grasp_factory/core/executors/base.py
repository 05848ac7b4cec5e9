"""The interface of executors, and the executor that needs no other process."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from grasp_factory.errors import WorkerError

J = TypeVar("J")
R = TypeVar("R")
SendMessage = Callable[[Any], None]
Task = Callable[[J, SendMessage], R]
"""``task(job, report)`` does a job; it may call ``report(message)`` while it does."""
Recover = Callable[[J, str], J]
"""``recover(job, why)`` returns the job that replaces one whose worker is lost, or raises."""
Silence = Callable[[Any], float]
"""``silence(message)`` returns for how many seconds a worker may be silent after a message.

The message is None when a worker begins a job. A worker that is silent for longer is lost.
The seconds come from ``retry_policy`` and, for an episode, from ``run_request``."""


class LostNode(str):
    """Why a job is lost: its node is, so nothing that the job did is to blame."""

    __slots__ = ()


def give_up(job: Any, why: str) -> Any:
    """Raise for every lost worker; this is the default for ``recover``.

    Raises:
        WorkerError: always.
    """
    raise WorkerError(
        f"a worker was lost in {job} ({why}); what is finished stays: run the same command again"
        " to go on"
    )


Check = Callable[[], None]
"""``check()`` is called several times a second while jobs run; what it raises ends the workers."""


def go_on() -> None:
    """Do nothing; this is the default for ``check`` and ``check_node``."""


def forever(message: Any) -> float:
    """Return infinity: a worker may be silent without limit."""
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
        *,
        check_node: Callable[[], None] = go_on,
    ) -> list[R]:
        """Run ``task`` once on each job and return the results in the order of ``jobs``.

        Each message of a task reaches ``report`` in this process, in the task's order. When the
        call returns or raises, none of its worker processes runs any more.

        Args:
            task: the function to run.
            jobs: its jobs.
            report: called with each message of a task.
            recover: returns the replacing job when a worker process dies, or is silent too long.
            silence: returns how long a worker process may be silent.
            check_node: called on each node of a cluster before it works. An error refuses the node,
                and the others do its part. On this machine nothing is called.

        Raises:
            WorkerError: if a worker process is lost, unless ``recover`` returns a job. An exception
                of the task is raised as it is.
        """


class InlineExecutor(Executor):
    """Runs one job after the other in this process: a crash of one job ends all of them."""

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
        """See ``Executor.run``."""
        return [task(job, report) for job in jobs]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutorSettings:
    """What an executor is made from."""

    workers: int
    """Worker processes, of each node."""
    address: str = ""
    """What stands after the colon of ``--executor NAME:ADDRESS``."""
    is_watched: bool = False
    """Whether a worker that is silent for too long must be ended."""
    tell: Callable[[str], None] = lambda text: None
    """Called with one line when a node joins, is refused or is lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutorKind:
    """A kind of executors: a row of the table in ``kinds``."""

    name: str
    description: str
    make: Callable[[ExecutorSettings], Executor]
    has_nodes: bool = False
    """Whether it works on other machines, which must see the store, and takes an address."""
