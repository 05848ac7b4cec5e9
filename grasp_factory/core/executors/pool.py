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
from collections.abc import Callable, Sequence
from dataclasses import dataclass

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
from grasp_factory.core.executors.team import JOBS_PER_PROCESS, Team

CHECK_S = 0.1
"""Seconds between two calls of an executor's ``check``."""


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
        *,
        check_node: Callable[[], None] = go_on,
    ) -> list[R]:
        """See ``Executor.run``."""
        todo = list(reversed(list(enumerate(jobs))))
        given: dict[int, J] = {}
        results: dict[int, R] = {}
        with contextlib.closing(Team(task, self.workers, silence, self.jobs_per_process)) as team:
            while todo or given:
                while todo and team.free:
                    place, given[place] = job = todo.pop()
                    team.give(*job)
                self.check()
                wait_s = math.inf if self.check is go_on else CHECK_S
                for kind, place, value in team.wait(wait_s=wait_s):
                    if kind == "message":
                        report(value)
                    elif kind == "error":
                        raise value
                    elif kind == "lost":
                        todo.append((place, recover(given.pop(place), value)))
                    else:
                        results[place] = value
                        del given[place]
        return [results[place] for place in range(len(jobs))]
