"""A Ray cluster of two nodes on loopback, whose processes can be found."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

LOOPBACK = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""Where it is 0, Ray takes 127.0.0.1 for what it is, and starts no second node."""
RAY = """
import sys
from ray._private import services
services.resolve_ip_for_localhost = lambda host: host  # it would be the outer address
from ray.scripts.scripts import main
sys.argv = ["ray", *sys.argv[1:]]
main()
"""
PORT = 26379
START_S = 180.0


class Nodes:
    """The processes of a cluster.

    Attributes:
        environment: variables of the cluster and of its users.
        address: for ``--executor``.
    """

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="rp-"))
        self.environment: Mapping[str, str] = os.environ | {
            "RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32),
            "RAY_TMPDIR": str(self.folder), "RAY_USAGE_STATS_ENABLED": "0",
            LOOPBACK: "0",
        }  # fmt: skip
        self.address = f"ray:127.0.0.1:{PORT}"
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        """Start a head and a second node, each in a process group of its own."""
        quiet = (
            "--node-ip-address=127.0.0.1",
            "--num-cpus=1",
            "--disable-usage-stats",
            "--include-log-monitor=false",
            "--block",
        )
        self._run("--head", f"--port={PORT}", "--include-dashboard=false", *quiet)
        _wait_for(lambda: len(self.raylets()) == 1)
        time.sleep(3.0)
        self._run(f"--address=127.0.0.1:{PORT}", *quiet)
        _wait_for(lambda: len(self.raylets()) == 2)

    def _run(self, *options: str) -> None:
        self._processes.append(
            subprocess.Popen(
                [sys.executable, "-c", RAY, "start", *options],
                env={**self.environment, LOOPBACK: "1"},
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        )  # fmt: skip

    def raylets(self) -> list[int]:
        """Return the raylets, that of the head first; numbers of processes start again at 1."""
        found = [pid for pid, command in self._all() if command[0].endswith("/raylet/raylet")]
        order = {process.pid: k for k, process in enumerate(self._processes)}
        return sorted(found, key=lambda pid: order.get(parent(pid), len(order)))

    def agents(self) -> list[int]:
        """Return the actors that are agents."""
        return [pid for pid, command in self._all() if command[0].startswith("ray::NodeActor")]

    def workers(self) -> list[int]:
        """Return the worker processes of the agents."""
        agents = set(self.agents())
        return [pid for pid, _ in self._all() if parent(pid) in agents]

    def node_of(self, raylet: int) -> list[int]:
        """Return all processes of a node but for those of the cluster's head."""
        return descendants(raylet)

    def pids(self) -> list[int]:
        """Return all processes of the cluster and of its users."""
        return [pid for pid, _ in self._all()]

    def _all(self) -> list[tuple[int, list[str]]]:
        mine = self.environment["RAY_AUTH_TOKEN"].encode()
        found = []
        for folder in Path("/proc").iterdir():
            if folder.name.isdecimal():
                with contextlib.suppress(OSError):
                    if mine in (folder / "environ").read_bytes():
                        command = (folder / "cmdline").read_bytes().decode().split("\0")
                        found.append((int(folder.name), command))
        return sorted(found)

    def stop(self) -> None:
        """End everything."""
        for pid, _ in self._all():
            if pid != os.getpid():
                send(pid, signal.SIGKILL)
        for process in self._processes:
            process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)


def parent(pid: int) -> int:
    """Return the parent of a process; 0 if it has ended."""
    with contextlib.suppress(OSError):
        return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return 0


def descendants(pid: int) -> list[int]:
    """Return a process, its children, their children, and so on."""
    children: dict[int, list[int]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            children.setdefault(parent(int(folder.name)), []).append(int(folder.name))
    found, todo = [], [pid]
    while todo:
        found.append(one := todo.pop())
        todo += children.get(one, [])
    return found


def send(pid: int, number: int) -> None:
    """Send a signal, if the process is still there."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _wait_for(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + START_S
    while not is_so():
        if time.monotonic() > deadline:
            raise SystemExit("Ray did not start")
        time.sleep(0.2)


@contextlib.contextmanager
def two_nodes() -> Iterator[Nodes]:
    """Yield a cluster of two nodes, which is ended afterwards."""
    nodes = Nodes()
    try:
        nodes.start()
        yield nodes
    finally:
        nodes.stop()
