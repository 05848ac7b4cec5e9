"""How quickly exports are written, against a bare loop, with two workers, and in how much memory.

    grasp-factory generate --n 64 --video-hz 10 --out grasps.zarr
    PYTHONPATH=tests python -m benchmarks.bench_export grasps.zarr [FORMAT ...]

The bare loop reads the same episodes with ``Dataset`` and encodes them by the format's own library,
without files of other formats, checks or moves (``bare_exports.py``). Each row is the median of
three rounds, in turn, in this process. With two workers an export is compared with two exports of
half of the episodes each, at the same time. Memory is the largest resident set of a process that
exports a twentieth of the episodes, and of one that exports all of them.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from benchmarks.bare_exports import BARE

from grasp_factory.core.text_format import table
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters import EXPORTERS

ROUNDS = 3
RSS = """
import re, sys
from grasp_factory.dataset.dataset import Dataset
dataset = Dataset(sys.argv[1], checked=True)
dataset.export(sys.argv[2], sys.argv[3], dataset.committed[: int(sys.argv[4])])
print(int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) // 1024)
"""
"""Prints the largest resident set; ``ru_maxrss`` may be that of the process that started it."""


def seconds(work: Callable[[Path], object], out: Path) -> float:
    """Return the time of writing to a path, which is removed afterwards."""
    started = time.perf_counter()
    work(out)
    taken = time.perf_counter() - started
    shutil.rmtree(out, ignore_errors=True)
    return taken


def command(store: Path, name: str, out: Path, rows: Sequence[int], workers: int) -> list[str]:
    listed = ",".join(map(str, rows))
    options = ["--to", name, "--episodes", listed, "--workers", str(workers)]
    return [sys.executable, "-m", "grasp_factory", "export", str(store), str(out), *options]


def at_once(commands: Sequence[list[str]]) -> float:
    """Return the time until commands, which run at the same time, have all ended."""
    started = time.perf_counter()
    running = [subprocess.Popen(words, stdout=subprocess.DEVNULL) for words in commands]
    for process in running:
        if process.wait():
            raise SystemExit(f"failed: {' '.join(map(str, process.args))}")
    return time.perf_counter() - started


def peak_mb(store: Path, name: str, out: Path, rows: int) -> int:
    words = [sys.executable, "-c", RSS, str(store), name, str(out), str(rows)]
    found = subprocess.run(words, check=True, capture_output=True, text=True)
    shutil.rmtree(out)
    return int(found.stdout)


def measured(dataset: Dataset, name: str, folder: Path) -> tuple[str, ...]:
    rows, out = dataset.committed.tolist(), folder / "out"
    ours, bare = [], []
    for _ in range(ROUNDS):
        ours.append(seconds(lambda path: dataset.export(name, path), out))
        if name in BARE:
            bare.append(seconds(lambda path: BARE[name](dataset, path), out))
    ratio = f"{statistics.median(ours) / statistics.median(bare):.2f}" if bare else ""
    halves = [rows[::2], rows[1::2]]
    two, apart = [], []
    for _ in range(ROUNDS):
        two.append(at_once([command(dataset.path, name, out, rows, 2)]))
        shutil.rmtree(out)
        outs = [folder / f"half{k}" for k in range(2)]
        pairs = zip(outs, halves, strict=True)
        apart.append(at_once([command(dataset.path, name, o, half, 1) for o, half in pairs]))
        for path in outs:
            shutil.rmtree(path)
    gain = f"{statistics.median(apart) / statistics.median(two):.2f}"
    memory = [peak_mb(dataset.path, name, out, max(1, len(rows) // 20)), 0]
    memory[1] = peak_mb(dataset.path, name, out, len(rows))
    took = 1e3 * statistics.median(ours) / len(rows)
    return name, f"{took:.1f}", ratio, gain, *(str(mb) for mb in memory)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("formats", nargs="*", default=list(EXPORTERS), metavar="FORMAT")
    chosen = parser.parse_args()
    dataset = Dataset(chosen.store, checked=True)
    head = ("format", "ms/episode", "of bare loop", "two workers", "MB of 1/20", "MB of all")
    lines = [head]
    with tempfile.TemporaryDirectory() as folder:
        for name in chosen.formats:
            lines.append(measured(dataset, name, Path(folder)))
            print(table(lines, right=range(1, 6)), end="\n\n", flush=True)


if __name__ == "__main__":
    main()
