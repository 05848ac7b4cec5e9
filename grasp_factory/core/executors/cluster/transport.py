"""What the coordinator needs of a cluster: nodes, and an agent on each that answers questions."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from grasp_factory.core.executors.base import Silence, Task
from grasp_factory.core.executors.team import Report
from grasp_factory.core.plugins.plugin_sources import PluginSource

Jobs = Sequence[tuple[int, Any]]
"""Jobs with their numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeSetup:
    """What an agent needs to know; everything in it must be picklable."""

    task: Task[Any, Any]
    workers: int
    """Worker processes of the node."""
    silence: Silence
    check_node: Callable[[], None]
    sources: tuple[PluginSource, ...]
    """Files of the user that the node may run."""


@dataclass(frozen=True, slots=True)
class NodeGone:
    """The answer of a cluster for an agent that ended."""

    why: str


class Answer(NamedTuple):
    """The answer of a node to one question."""

    node: str
    content: Sequence[Report] | NodeGone


class Transport(ABC):
    """A cluster. The coordinator alone uses it, from one thread."""

    @abstractmethod
    def nodes(self) -> Sequence[str]:
        """Return the names of all nodes that are there now; a name is never used again."""

    @abstractmethod
    def start(self, node: str, setup: NodeSetup) -> None:
        """Begin to start an agent on a node, and return at once."""

    @abstractmethod
    def ask(self, node: str, jobs: Jobs) -> None:
        """Give an agent jobs and ask for its reports, and return at once.

        There is one question at a time for each agent. See ``Agent.exchange``.
        """

    @abstractmethod
    def answer(self, wait_s: float) -> Answer | None:
        """Return the next answer of any node, or None if no node answers in that time."""

    @abstractmethod
    def drop(self, node: str) -> None:
        """End the agent of a node, as far as that can be done; do not wait for it."""

    @abstractmethod
    def close(self) -> None:
        """End all agents, and leave the cluster."""

    def now(self) -> float:
        """Return a time in seconds that never goes back."""
        return time.monotonic()
