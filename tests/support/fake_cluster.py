"""A cluster on this machine: real agents with real pools, and a transport whose nodes can fail."""

from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Sequence

from grasp_factory.core.executors.cluster.agent import Agent
from grasp_factory.core.executors.cluster.coordinator import pickled
from grasp_factory.core.executors.cluster.transport import (
    Answer,
    Jobs,
    NodeGone,
    NodeSetup,
    Transport,
)
from grasp_factory.core.executors.team import Report


class FakeCluster(Transport):
    """Agents in threads of this process.

    Attributes:
        late_s: seconds by which the clock of the coordinator is ahead.
        silent: nodes whose answers are held back.
        given: what each node was given, by name.
    """

    def __init__(self, *names: str) -> None:
        self.late_s = 0.0
        self.silent, self.dropped = set[str](), list[str]()
        self.given: dict[str, list[object]] = {}
        self.on_ask: Callable[[str, Jobs], None] = lambda node, jobs: None
        self._names, self._agents = names, dict[str, Agent]()
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []

    def nodes(self) -> Sequence[str]:
        return self._names

    def start(self, node: str, setup: NodeSetup) -> None:
        self._agents[node] = Agent(pickled(setup))

    def ask(self, node: str, jobs: Jobs) -> None:
        self.on_ask(node, jobs)
        self.given.setdefault(node, []).extend(job for _, job in jobs)
        if node not in self.silent:
            thread = threading.Thread(target=self._answer, args=(node, jobs))
            self._threads.append(thread)
            thread.start()

    def _answer(self, node: str, jobs: Jobs) -> None:
        content = self._agents[node].exchange(jobs)
        if node not in self.silent:
            self._answers.put(Answer(node, content))

    def end(self, node: str, why: str) -> None:
        """Let a node be gone."""
        self.silent.add(node)
        self.say(node, NodeGone(why))

    def say(self, node: str, content: Sequence[Report] | NodeGone) -> None:
        """Let a node say something, whether it is known or not."""
        self._answers.put(Answer(node, content))

    def answer(self, wait_s: float) -> Answer | None:
        with contextlib.suppress(queue.Empty):
            return self._answers.get(timeout=0.1)
        return None

    def drop(self, node: str) -> None:
        self.dropped.append(node)

    def now(self) -> float:
        return super().now() + self.late_s

    def close(self) -> None:
        for agent in self._agents.values():
            agent.close()
        for thread in self._threads:
            thread.join()
