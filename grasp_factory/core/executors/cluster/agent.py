"""The agent of a node: it runs the pool of processes there, and collects its reports."""

from __future__ import annotations

import contextlib
import pickle
import threading
import time
from collections import deque
from multiprocessing import connection
from typing import Any

from grasp_factory.core.executors.cluster.transport import Jobs, NodeSetup
from grasp_factory.core.executors.team import Report, Team
from grasp_factory.core.plugins.plugin_sources import allow
from grasp_factory.errors import GraspFactoryError, UsageError

BATCH_S = 2.0
"""Longest time until an agent answers, seconds. A shorter one makes more and smaller answers."""
ALONE_S = 60.0
"""Seconds without a question after which an agent ends its workers: its run counts it as lost."""
READY, REFUSED, ENDED = "ready", "refused", "ended"
"""Kinds of reports of the agent itself: it can work, it cannot, and why it ended."""
_NO_JOB = -1


class Agent:
    """Does jobs with a team of worker processes, in a thread of its own."""

    def __init__(self, setup: bytes) -> None:
        """Begin to check the node, then to work.

        Args:
            setup: a pickled ``NodeSetup``.
        """
        self._changed = threading.Condition()
        self._jobs: deque[tuple[int, Any]] = deque()
        self._reports: list[Report] = []
        self._is_urgent = self._is_closed = False
        self._asked = time.monotonic()
        self._ours, self._wake = connection.Pipe(duplex=False)
        self._thread = threading.Thread(target=self._run, args=(setup,), daemon=True)
        self._thread.start()

    def exchange(self, jobs: Jobs) -> list[Report]:
        """Take jobs, and return the reports since the last call.

        It returns at once if a worker is free or lost, else after ``BATCH_S``.
        """
        with self._changed:
            self._asked = time.monotonic()
            self._jobs.extend(jobs)
            if jobs:
                self._wake.send_bytes(b"j")
            self._changed.wait_for(lambda: self._is_urgent, BATCH_S)
            found, self._reports, self._is_urgent = self._reports, [], False
            return found

    def close(self) -> None:
        """End the workers."""
        self._is_closed = True
        self._wake.send_bytes(b"c")
        self._thread.join()

    def _run(self, pickled: bytes) -> None:
        try:
            setup: NodeSetup = pickle.loads(pickled)
            allow(setup.sources)
            setup.check_node()
        except Exception as error:
            self._tell(Report(REFUSED, _NO_JOB, _as_refusal(error)))
            return
        self._tell(Report(READY, _NO_JOB, setup.workers))
        try:
            with contextlib.closing(Team(setup.task, setup.workers, setup.silence)) as team:
                while not self._is_closed and time.monotonic() < self._asked + ALONE_S:
                    self._give(team)
                    for report in team.wait(self._ours, wait_s=ALONE_S / 4):
                        self._tell(report)
                    while self._ours.poll():
                        self._ours.recv_bytes()
        except Exception as error:
            self._tell(Report(ENDED, _NO_JOB, f"{type(error).__name__}: {error}"))

    def _give(self, team: Team) -> None:
        while team.free and self._jobs:
            team.give(*self._jobs.popleft())

    def _tell(self, report: Report) -> None:
        with self._changed:
            self._reports.append(report)
            if report.kind != "message":
                self._is_urgent = True
                self._changed.notify_all()


def _as_refusal(error: Exception) -> GraspFactoryError:
    if isinstance(error, GraspFactoryError):
        return error
    text = " ".join(str(error).split())[:300]
    return UsageError(f"{type(error).__name__}: {text}")
