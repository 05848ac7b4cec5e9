"""An executor whose calling process works too, while its workers start."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.executors.base import (
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
from grasp_factory.core.executors.team import Team
from grasp_factory.core.executors.worker import Worker


@dataclass(frozen=True, slots=True)
class SharingExecutor(Executor):
    """This process and spawned processes do the jobs together: for tasks that crash nothing.

    The task must report often, because a worker gets its next job when this process's job reports.
    """

    processes: int
    """Processes that work, this one among them."""
    ready: Sequence[Worker] = ()
    """Workers that ``early_workers`` started."""

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
        team = Team(task, self.processes - 1, silence, len(jobs), self.ready)
        with contextlib.closing(team):
            work = JobRound(team, jobs, report, recover)

            def report_and_attend(message: Any) -> None:
                report(message)
                work.hear(wait_s=0.0)
                work.hand_out()

            while work.is_open:
                own = work.take()
                work.hand_out()
                if own:
                    place, job = own
                    work.keep(place, task(job, report_and_attend))
                    work.hear(wait_s=0.0)
                else:
                    work.hear(wait_s=math.inf)
        return work.results
