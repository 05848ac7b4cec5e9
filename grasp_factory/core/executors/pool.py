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
from grasp_factory.core.executors.job_round import JobRound
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
        wait_s = math.inf if self.check is go_on else CHECK_S
        with contextlib.closing(Team(task, self.workers, silence, self.jobs_per_process)) as team:
            work = JobRound(team, jobs, report, recover)
            while work.is_open:
                work.hand_out()
                self.check()
                work.hear(wait_s)
        return work.results
