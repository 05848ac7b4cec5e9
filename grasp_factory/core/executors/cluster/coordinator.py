"""The coordinator: it gives jobs to the agents of a cluster, and notices nodes that are lost."""

from __future__ import annotations

import contextlib
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from grasp_factory.core.executors.base import (
    Executor,
    J,
    LostNode,
    R,
    Recover,
    SendMessage,
    Silence,
    Task,
    forever,
    give_up,
    go_on,
)
from grasp_factory.core.executors.cluster.agent import ENDED, READY, REFUSED
from grasp_factory.core.executors.cluster.transport import (
    Answer,
    NodeGone,
    NodeSetup,
    Transport,
)
from grasp_factory.core.executors.team import Report
from grasp_factory.core.plugins.plugin_sources import allowed
from grasp_factory.errors import UsageError, WorkerError

HEARTBEAT_S = 20.0
"""Seconds after which a node that does not answer counts as lost. An agent answers in one second.
Ray itself needs 64 s to notice a node that hangs."""
START_S = 180.0
"""Seconds that an agent may take to start: it imports the package from a disk that nodes share."""
LOOK_S = 1.0
"""Seconds between looks at which nodes are late, and which are new."""
_OVERSLEPT_S = 5.0
"""Seconds of delay after which this process assumes that it was itself suspended."""


@dataclass(slots=True)
class _Node:
    """A node with an agent, and the question that it has not answered yet."""

    name: str
    since: float
    """When it was asked."""
    patience: float = START_S
    jobs: dict[int, Any] = field(default_factory=dict)
    """What it has in hand, by number."""
    workers: int = 0
    """0 until it is ready."""


@dataclass(frozen=True, slots=True)
class ClusterExecutor(Executor):
    """Runs jobs on the nodes of a cluster; the task, jobs, messages and results are pickled."""

    connect: Callable[[], Transport]
    """Connects to the cluster when a run begins."""
    workers: int
    """Worker processes of each node."""
    tell: Callable[[str], None] = lambda text: None
    """Called with one line when a node joins, is refused or is lost."""

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
        """See ``Executor.run``. A node that is lost is no fault of the jobs it has in hand.

        Raises:
            UsageError: if all nodes are refused.
            WorkerError: if all nodes are lost.
        """
        if not jobs:
            return []
        setup = NodeSetup(
            task=task, workers=self.workers, silence=silence, check_node=check_node,
            sources=allowed(),
        )  # fmt: skip
        with contextlib.closing(self.connect()) as transport:
            return _Run(transport, setup, jobs, _Listeners(report, recover, self.tell)).results()


class _Listeners(NamedTuple):
    """Functions of the run's caller."""

    report: SendMessage
    recover: Recover[Any]
    tell: Callable[[str], None]


class _Run:
    """The state of one run."""

    def __init__(
        self,
        transport: Transport,
        setup: NodeSetup,
        jobs: Sequence[Any],
        listeners: _Listeners,
    ) -> None:
        self._transport, self._setup = transport, setup
        self._report, self._recover, self._tell = listeners
        self._todo = list(reversed(list(enumerate(jobs))))
        self._results: dict[int, Any] = {}
        self._count = len(jobs)
        self._nodes: dict[str, _Node] = {}
        self._known = set[str]()
        """All nodes that were ever there: one that is lost does not come back."""
        self._refused: UsageError | None = None

    def results(self) -> list[Any]:
        """Do all jobs, and return their results in their order."""
        looked = -LOOK_S
        while len(self._results) < self._count:
            now = self._transport.now()
            if now >= looked + LOOK_S:
                if looked >= 0.0 and now > looked + LOOK_S + _OVERSLEPT_S:
                    self._give_time(now)
                self._look(now)
                looked = now
            answer = self._transport.answer(LOOK_S)
            if answer is not None and answer.node in self._nodes:
                self._take(answer)
        return [self._results[place] for place in range(self._count)]

    def _give_time(self, now: float) -> None:
        """Let all nodes answer: this process was suspended, and has not heard them."""
        for node in self._nodes.values():
            node.since = now

    def _look(self, now: float) -> None:
        """Start agents on new nodes, and give up those that do not answer."""
        for name in self._transport.nodes():
            if name not in self._known:
                self._known.add(name)
                self._nodes[name] = _Node(name, now)
                self._transport.start(name, self._setup)
                self._transport.ask(name, ())
        for node in [n for n in self._nodes.values() if now > n.since + n.patience]:
            self._lose(node, f"did not answer for {node.patience:g} s")
        if not self._nodes:
            raise self._refused or WorkerError(
                "no node of the cluster is left; what is finished stays: run the same command"
                " again to go on"
            )

    def _take(self, answer: Answer) -> None:
        """Process an answer, and ask the next question."""
        node = self._nodes[answer.node]
        if isinstance(answer.content, NodeGone):
            self._lose(node, answer.content.why)
            return
        for report in answer.content:
            self._hear(node, report)
        if node.name in self._nodes:
            self._ask(node)

    def _ask(self, node: _Node) -> None:
        given = []
        while self._todo and len(node.jobs) < node.workers:
            place, node.jobs[place] = job = self._todo.pop()
            given.append(job)
        node.since, node.patience = self._transport.now(), HEARTBEAT_S
        self._transport.ask(node.name, given)

    def _hear(self, node: _Node, report: Report) -> None:
        kind, place, value = report
        if kind == "message":
            self._report(value)
        elif kind == "result":
            self._results[place] = value
            del node.jobs[place]
        elif kind == "lost":
            self._todo.append((place, self._recover(node.jobs.pop(place), value)))
        elif kind == READY:
            node.workers = value
            ready = sum(n.workers > 0 for n in self._nodes.values())
            self._tell(f"node {node.name} has {_count(value, 'worker')} ({_count(ready, 'node')})")
        elif kind == REFUSED:
            self._refused = value
            del self._nodes[node.name]
            self._transport.drop(node.name)
            self._tell(f"node {node.name} is refused: {value}")
        elif kind == ENDED:
            self._lose(node, value)
        else:
            raise value

    def _lose(self, node: _Node, why: str) -> None:
        del self._nodes[node.name]
        self._transport.drop(node.name)
        left = sum(n.workers > 0 for n in self._nodes.values())
        self._tell(f"node {node.name} is lost: {why} ({_count(left, 'node')} left)")
        for place, job in reversed(node.jobs.items()):
            self._todo.append((place, self._recover(job, LostNode(f"its node is lost: {why}"))))


def pickled(setup: NodeSetup) -> bytes:
    """Return a setup as the bytes that an agent begins with."""
    return pickle.dumps(setup)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
