"""What an episode costs on two nodes of one worker, against the local pool with two workers.

    PYTHONPATH=tests python -m ray_peers.rate [PAIRS]

It measures the time of the processor of all processes, Ray's own too, between the third block that
is finished and the last but two, so that starting and ending are not in it, and other work on the
machine does not count. The runs are made in turns, on this machine.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from ray_peers.cluster import Nodes, descendants, two_nodes

N, BLOCK, WORKERS, APART = 240, 8, 2, 2
COMMAND = (
    *(sys.executable, "-m", "grasp_factory", "generate", "--n", str(N), "--quiet"),
    *("--set", f"block_size={BLOCK}"),
)
TICKS = os.sysconf("SC_CLK_TCK")


def cost(
    options: tuple[str, ...], environment: Mapping[str, str], more: Callable[[], list[int]]
) -> float:
    """Return the seconds of the processor that an episode takes.

    Args:
        options: of the command.
        environment: of the command.
        more: returns the processes that belong to the run, beside its own.
    """
    samples: list[tuple[int, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "ds.zarr")
        command = [*COMMAND, "--out", str(out), *options]
        run = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        while run.poll() is None:
            done = _finished(out)
            if APART < done < N // BLOCK - APART:
                samples.append((done, _used({*descendants(run.pid), *more()})))
            time.sleep(0.2)
    (first, before), (last, after) = samples[0], samples[-1]
    return (after - before) / ((last - first) * BLOCK)


def _finished(out: Path) -> int:
    with contextlib.suppress(FileNotFoundError):
        return sum(name.isdecimal() for name in os.listdir(out / "episodes" / "status"))
    return 0


def _used(pids: set[int]) -> float:
    """Return the seconds of the processor that processes have used, with their ended children."""
    total = 0
    for pid in pids:
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            total += sum(map(int, fields[11:15]))
    return total / TICKS


def measure(nodes: Nodes, pairs: int) -> list[float]:
    """Measure pairs, print them, and return what the pool costs relative to the two nodes."""
    here = ("--workers", str(WORKERS))
    there = ("--workers", str(WORKERS // 2), "--executor", nodes.address)
    ratios = []
    for _ in range(pairs):
        alone, both = cost(here, os.environ, list), cost(there, nodes.environment, nodes.pids)
        ratios.append(alone / both)
        print(f"{alone:.3f} s local, {both:.3f} s two nodes, {ratios[-1]:.3f}", flush=True)
    return ratios


def main() -> None:
    """Measure and print the median."""
    with two_nodes() as nodes:
        ratios = measure(nodes, int(sys.argv[1]) if len(sys.argv) > 1 else 5)
    print(f"median {statistics.median(ratios):.3f}")


if __name__ == "__main__":
    main()
