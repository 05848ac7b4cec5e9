"""A cluster of Ray: an actor on each node is the agent there.

Ray starts the agents and carries the messages. It does not decide which nodes are lost, and nothing
depends on its word that an agent has ended: the store takes two writers of a block.
"""

from __future__ import annotations

import contextlib
import os
import queue
import secrets
import shutil
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

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
from grasp_factory.core.optional import require
from grasp_factory.errors import UsageError, shown

LOOPBACK = "127.0.0.1"
_QUIET = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
"""Ray tells its makers nothing; actors without a GPU leave the variables of GPUs alone."""
_LOOPBACK_ONLY = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
"""Without it Ray takes the machine's outer address for 127.0.0.1, and listens there."""
_LONGEST_WHY = 200
CONNECT_S = 10.0
"""Seconds for somebody to answer at a cluster's address."""


class NodeActor:
    """The actor of Ray on a node."""

    def __init__(self, setup: bytes) -> None:
        # Spawned processes import the file of their parent's main module, which here is Ray's.
        sys.modules["__main__"].__dict__.pop("__file__", None)
        self._agent = Agent(setup)

    def exchange(self, jobs: Jobs) -> list[Report]:
        """See ``Agent.exchange``."""
        return self._agent.exchange(jobs)


class RayCluster(Transport):
    """The nodes of a Ray cluster, or this machine as a cluster of one node."""

    def __init__(self, address: str = "") -> None:
        """Connect.

        Args:
            address: of a running cluster, HOST:PORT or ``auto`` for the one of this machine; empty
                to start Ray here for this run. It then listens on loopback only, and asks for a
                token that only this process knows, or that of RAY_AUTH_TOKEN.

        Raises:
            MissingLibraryError: if Ray is not installed.
            UsageError: if there is no such cluster, or it refuses this process.
        """
        require("ray", extra="ray")
        os.environ.update(_QUIET)
        self._folder = "" if address else tempfile.mkdtemp(prefix="ray-")
        self._before = dict(os.environ)
        if not address:
            token = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": _own_token()}
            os.environ.update({**token, **_LOOPBACK_ONLY, "RAY_TMPDIR": self._folder})
        import ray  # noqa: PLC0415 -- it reads the variables when it is imported

        self._ray = ray
        self._actors: dict[str, Any] = {}
        self._ids: dict[str, str] = {}
        self._answers: queue.SimpleQueue[Answer] = queue.SimpleQueue()
        try:
            check_answers(address)
            with _own_signals():
                ray.init(**_options(address))
            if not address:
                _check_loopback(ray.nodes())
        except Exception as error:
            self._leave()
            where = shown(address) if address else "this machine"
            raise UsageError(
                f"Ray cannot be used at {where}: {_one_line(error)}; valid: --executor ray, or"
                " ray:HOST:PORT of a running cluster, whose token is in RAY_AUTH_TOKEN"
            ) from None

    def nodes(self) -> Sequence[str]:
        """See ``Transport.nodes``."""
        try:
            found = [node for node in self._ray.nodes() if node["Alive"]]
        except Exception:  # the head does not answer: those that are known go on
            return tuple(self._ids)
        self._ids.update({_name(node): node["NodeID"] for node in found})
        return [_name(node) for node in found]

    def start(self, node: str, setup: NodeSetup) -> None:
        """See ``Transport.start``."""
        from ray.util.scheduling_strategies import (  # noqa: PLC0415
            NodeAffinitySchedulingStrategy,
        )

        where = NodeAffinitySchedulingStrategy(self._ids[node], soft=False)
        actor = self._ray.remote(NodeActor)
        options = actor.options(
            num_cpus=0,
            max_restarts=0,
            max_concurrency=1,  # with more, Ray's main thread wakes up a hundred times a second
            scheduling_strategy=where,
            enable_task_events=False,  # nobody looks at the questions one by one
        )
        self._actors[node] = options.remote(pickled(setup))

    def ask(self, node: str, jobs: Jobs) -> None:
        """See ``Transport.ask``."""
        future = self._actors[node].exchange.remote(tuple(jobs)).future()
        future.add_done_callback(lambda done: self._answers.put(_answer(node, done)))

    def answer(self, wait_s: float) -> Answer | None:
        """See ``Transport.answer``."""
        with contextlib.suppress(queue.Empty):
            return self._answers.get(timeout=wait_s)
        return None

    def drop(self, node: str) -> None:
        """See ``Transport.drop``."""
        actor = self._actors.pop(node, None)
        if actor is not None:
            with contextlib.suppress(Exception):
                self._ray.kill(actor, no_restart=True)

    def close(self) -> None:
        """See ``Transport.close``."""
        for node in list(self._actors):
            self.drop(node)
        self._leave()

    def _leave(self) -> None:
        with contextlib.suppress(Exception), _own_signals():
            self._ray.shutdown()
        own = ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_TMPDIR", *_LOOPBACK_ONLY)
        for name in own if self._folder else ():
            os.environ.pop(name, None)
            if name in self._before:
                os.environ[name] = self._before[name]
        if self._folder:
            shutil.rmtree(self._folder, ignore_errors=True)


@cache
def _own_token() -> str:
    """Return the token of the clusters that this process starts: Ray reads it only once."""
    return os.environ.get("RAY_AUTH_TOKEN") or secrets.token_hex(32)


def _options(address: str) -> dict[str, Any]:
    more = {"configure_logging": False, "log_to_driver": False}
    if address:
        return {"address": address, **more}
    return {"_node_ip_address": LOOPBACK, "include_dashboard": False, **more}


def check_answers(address: str) -> None:
    """Check that somebody is at HOST:PORT, where Ray itself would wait for many minutes.

    Raises:
        OSError: if nobody is.
    """
    host, _, port = address.rpartition(":")
    if host and port.isdecimal():
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()


def _check_loopback(nodes: Sequence[Mapping[str, Any]]) -> None:
    if {node["NodeManagerAddress"] for node in nodes} != {LOOPBACK}:
        raise RuntimeError("it listens on an outer interface; start it in a fresh process")


def _answer(node: str, done: Any) -> Answer:
    error = done.exception()
    return Answer(node, done.result() if error is None else NodeGone(_one_line(error)))


def _name(node: Mapping[str, Any]) -> str:
    return f"{node['NodeManagerHostname']}-{node['NodeID'][:6]}"


def _one_line(error: BaseException) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    sentence = lines[-1].partition(". ")[0].rstrip(".") if lines else type(error).__name__
    return sentence[:_LONGEST_WHY]


@contextlib.contextmanager
def _own_signals() -> Iterator[None]:
    """Keep this process's handlers of signals: Ray sets its own."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
