"""bin/check-ray: faults of a real cluster at random instants; the store must stay as it must be."""

from __future__ import annotations

import contextlib
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from support.helpers import tree

from ray_peers.cluster import Nodes, send, two_nodes

N = 24
COMMAND = (
    *(sys.executable, "-m", "grasp_factory", "generate", "--seed", "5", "--n", str(N)),
    *("--workers", "1", "--resolution", "48x36", "--set", "block_size=2"),
)
LONGEST_S = 400.0
PAST_HEARTBEAT_S = 70.0
"""Longer than Ray's own 65 s, too."""

Fault = Callable[[Nodes, "subprocess.Popen[str]"], list[int]]
"""Does it; returns the processes that are stopped and go on later."""


def worker_killed(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Kill one worker process of an agent."""
    _kill_one(nodes.workers, run)
    return []


def agent_killed(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Kill one agent."""
    _kill_one(nodes.agents, run)
    return []


def raylet_killed(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Kill the raylet of the second node."""
    send(nodes.raylets()[-1], signal.SIGKILL)
    return []


def node_killed(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Kill all processes of the second node."""
    for pid in nodes.node_of(nodes.raylets()[-1]):
        send(pid, signal.SIGKILL)
    return []


def driver_killed(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Kill the command; the same command must complete the store."""
    run.kill()
    return []


def raylet_stopped(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Stop the raylet of the second node."""
    return _stopped([nodes.raylets()[-1]])


def agent_stopped(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Stop one agent, and not its workers."""
    return _stopped([random.choice(agents)] if (agents := nodes.agents()) else [])


def both_stopped(nodes: Nodes, run: subprocess.Popen[str]) -> list[int]:
    """Stop all processes of the second node."""
    return _stopped(nodes.node_of(nodes.raylets()[-1]))


def _kill_one(pids: Callable[[], list[int]], run: subprocess.Popen[str]) -> None:
    """Kill one of some processes as soon as there is one, unless the run ends before."""
    while run.poll() is None:
        if found := pids():
            send(random.choice(found), signal.SIGKILL)
            return
        time.sleep(0.05)


def _stopped(pids: list[int]) -> list[int]:
    for pid in pids:
        send(pid, signal.SIGSTOP)
    return pids


FAULTS: dict[str, Fault] = {
    "worker-killed": worker_killed,
    "agent-killed": agent_killed,
    "raylet-killed": raylet_killed,
    "node-killed": node_killed,
    "driver-killed": driver_killed,
    "raylet-stopped": raylet_stopped,
    "agent-stopped": agent_stopped,
    "both-stopped": both_stopped,
}


def start(nodes: Nodes, out: Path) -> subprocess.Popen[str]:
    """Start the command on the cluster."""
    command = [*COMMAND, "--out", str(out), "--executor", nodes.address]
    return subprocess.Popen(command, env=nodes.environment, stderr=subprocess.PIPE, text=True)


def wait_for_work(nodes: Nodes, run: subprocess.Popen[str]) -> None:
    """Wait until both agents have a worker."""
    deadline = time.monotonic() + 120.0
    while len(nodes.workers()) < 2 and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.2)


def check(name: str, want: Path, folder: Path, wait_s: float) -> str:
    """Do a fault so many seconds after the work has begun; return what happened."""
    out = folder / "ds.zarr"
    with two_nodes() as nodes:
        run = start(nodes, out)
        wait_for_work(nodes, run)
        time.sleep(wait_s)
        stopped = FAULTS[name](nodes, run) if run.poll() is None else []
        struck = time.monotonic()
        _, said = run.communicate(timeout=LONGEST_S)
        text = f"{time.monotonic() - struck:.0f} s more, exit code {run.returncode}"
        if stopped:
            time.sleep(max(0.0, struck + PAST_HEARTBEAT_S - time.monotonic()))
            for pid in stopped:
                send(pid, signal.SIGCONT)
            time.sleep(5.0)  # what has hung writes now, if it will
        again = start(nodes, out)
        _, more = again.communicate(timeout=LONGEST_S)
        if again.returncode:
            raise SystemExit(
                f"{name}: the same command ended with {again.returncode}: {said}{more}"
            )
    wanted, found = tree(want), tree(out)
    differ = [f for f in wanted.keys() | found.keys() if wanted.get(f) != found.get(f)]
    if differ:
        raise SystemExit(f"{name}: differ: {sorted(differ)[:20]}; {said}")
    left = {path.name for path in folder.iterdir()} - {"ds.zarr", "ds.zarr.runs.jsonl"}
    if left:
        raise SystemExit(f"{name}: left beside the store: {sorted(left)}")
    losses = [line for line in said.splitlines() if "lost" in line]
    return f"{text}; {'; '.join(losses[:2])}"


def main() -> None:
    """Do each fault at so many instants."""
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    with tempfile.TemporaryDirectory() as above:
        want, begun = Path(above, "want.zarr"), time.monotonic()
        subprocess.run([*COMMAND, "--out", str(want), "--quiet"], check=True)
        seconds = time.monotonic() - begun
        for name in sys.argv[2:] or FAULTS:
            for number in range(times):
                with contextlib.closing(_Folder()) as folder:
                    wait_s = random.uniform(0.0, 0.5 * seconds)
                    what = check(name, want, folder.path, wait_s)
                    print(
                        f"{name} {number + 1}/{times}, after {wait_s:.1f} s: same; {what}",
                        flush=True,
                    )


class _Folder:
    """A temporary folder that ends with ``close``."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self.path = Path(self._folder.name)

    def close(self) -> None:
        self._folder.cleanup()


if __name__ == "__main__":
    main()
