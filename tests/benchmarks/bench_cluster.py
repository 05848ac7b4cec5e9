"""The real coordinator with 1,000 simulated nodes that fail: its processor time and its rate.

``PYTHONPATH=tests python -m benchmarks.bench_cluster [NODES [WORKERS]]``. Time is simulated: nodes
make episodes and are lost as the constants say. The coordinator, the bookkeeping of losses, and the
pickled messages are the real ones; Ray's own cost of a call is not in it.
"""

from __future__ import annotations

import heapq
import pickle
import random
import sys
import time
from collections import deque
from collections.abc import Sequence

from grasp_factory.core.executors.base import go_on
from grasp_factory.core.executors.cluster.agent import BATCH_S, READY
from grasp_factory.core.executors.cluster.coordinator import ClusterExecutor
from grasp_factory.core.executors.cluster.transport import (
    Answer,
    Jobs,
    NodeGone,
    NodeSetup,
    Transport,
)
from grasp_factory.core.executors.team import Report
from grasp_factory.factory.block_job import Begun, BlockJob, Committed, Made
from grasp_factory.factory.retry_policy import Failures, Losses

BLOCK = 8
EPISODE_S = 0.75
"""Mean time of an episode on one worker; a node of 8 workers makes 10.7 a second."""
RUN_S = 60.0
"""Simulated seconds of work."""
LOST_PER_NODE_S = 1.0 / 20_000.0
HANGS_PER_NODE_S = 1.0 / 20_000.0
DEATHS_PER_BLOCK = 1.0 / 500.0
"""Of a worker, between two episodes."""
START_S, LATENCY_S = 5.0, 0.005


class SimulatedCluster(Transport):
    """Nodes that take simulated time."""

    def __init__(self, nodes: int) -> None:
        self._random = random.Random(0)
        self._clock, self._order = 0.0, 0
        self._names = [f"node-{k}" for k in range(nodes)]
        self._events: list[tuple[float, int, str, bytes | NodeGone]] = []
        self._workers: dict[str, list[float]] = {}
        self._found: dict[str, deque[tuple[float, Report]]] = {}
        self._lost = {
            name: self._random.expovariate(LOST_PER_NODE_S + HANGS_PER_NODE_S)
            for name in self._names
        }
        self.messages = self.questions = self.gone = self.hung = 0

    def now(self) -> float:
        return self._clock

    def nodes(self) -> Sequence[str]:
        return self._names

    def start(self, node: str, setup: NodeSetup) -> None:
        self._workers[node] = [START_S] * setup.workers
        self._found[node] = deque([(START_S, Report(READY, -1, setup.workers))])

    def ask(self, node: str, jobs: Jobs) -> None:
        self.questions += 1
        for place, job in pickle.loads(pickle.dumps(jobs)):
            self._work(node, place, job)
        found = self._found[node]
        urgent = next((at for at, report in found if report.kind != "message"), float("inf"))
        at = max(self._clock, min(self._clock + BATCH_S, urgent)) + LATENCY_S
        if at > self._lost[node]:
            if self._random.random() < 0.5:
                self.hung += 1  # it never answers
                return
            self.gone += 1
            self._push(at + 1.4, node, NodeGone("its process died"))
            return
        batch = []
        while found and found[0][0] <= at:
            batch.append(found.popleft()[1])
        self.messages += len(batch)
        self._push(at, node, pickle.dumps(batch))

    def _work(self, node: str, place: int, job: BlockJob) -> None:
        workers = self._workers[node]
        at = max(min(workers), self._clock)
        which, reports = workers.index(min(workers)), []
        is_lost = self._random.random() < DEATHS_PER_BLOCK
        for index in range(BLOCK * job.block, BLOCK * (job.block + 1)):
            reports.append((at, Report("message", place, Begun(index=index))))
            at += self._random.uniform(0.5, 1.5) * EPISODE_S
            made = Made(index=index, policy="uniform", outcome="success")
            reports.append((at, Report("message", place, made)))
        if is_lost:
            reports.append((at, Report("lost", place, "SIGKILL")))
        else:
            reports.append((at, Report("message", place, Committed(block=job.block))))
            reports.append((at, Report("result", place, None)))
        workers[which] = at
        self._found[node] = deque(sorted([*self._found[node], *reports], key=lambda one: one[0]))

    def _push(self, at: float, node: str, content: bytes | NodeGone) -> None:
        self._order += 1
        heapq.heappush(self._events, (at, self._order, node, content))

    def answer(self, wait_s: float) -> Answer | None:
        if not self._events or self._events[0][0] > self._clock + wait_s:
            self._clock += wait_s
            return None
        at, _, node, content = heapq.heappop(self._events)
        self._clock = max(self._clock, at)
        return Answer(node, pickle.loads(content) if isinstance(content, bytes) else content)

    def drop(self, node: str) -> None:
        self._found.pop(node, None)

    def close(self) -> None:
        pass


class _Measured(SimulatedCluster):
    """Takes the time of the simulation itself out of the coordinator's, but not of unpickling."""

    def __init__(self, nodes: int) -> None:
        super().__init__(nodes)
        self.own_s = 0.0

    def ask(self, node: str, jobs: Jobs) -> None:
        begun = time.process_time()
        super().ask(node, jobs)
        self.own_s += time.process_time() - begun


def main() -> None:
    """Run it and print the figures."""
    nodes = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 8
    blocks = int(nodes * workers * RUN_S / EPISODE_S / BLOCK)
    cluster, made, said = _Measured(nodes), [0], list[str]()
    losses = Losses(BLOCK, 600.0, lambda text: None)
    failures = Failures(0.25, blocks * BLOCK)

    def hear(message: Begun | Made | Committed) -> None:
        new = losses.news(message)
        if new is not None:
            made[0] += 1
            failures.count(new)

    jobs = [BlockJob(block=block) for block in range(blocks)]
    executor = ClusterExecutor(lambda: cluster, workers, said.append)
    begun = time.process_time()
    executor.run(len, jobs, hear, losses.recover, losses.silence, check_node=go_on)
    used = time.process_time() - begun - cluster.own_s
    took = cluster.now() - START_S
    assert made[0] == blocks * BLOCK
    print(f"{nodes} nodes of {workers} workers, {made[0]:,} episodes in {took:.0f} simulated s")
    print(f"lost: {cluster.gone} nodes at once, {cluster.hung} by hanging")
    print(f"{made[0] / took:,.0f} episodes/s, {cluster.messages / took:,.0f} messages/s in"
          f" {cluster.questions / took:,.0f} answers/s")  # fmt: skip
    print(f"coordinator: {1e3 * used / cluster.messages:.4f} ms a message, {used / took:.2f} of a"
          f" core; at one core {made[0] / used:,.0f} episodes/s")  # fmt: skip


if __name__ == "__main__":
    main()
