"""How much memory an export takes, for few and for many episodes.

    grasp-factory generate --n 128 --camera front --camera overhead --clutter 3 --video-hz 2 \
        --out grasps.zarr
    PYTHONPATH=tests python -m benchmarks.bench_export_memory grasps.zarr [FORMAT ...] [--rows 2000]

The episodes of the store repeat until there are ``--rows``. A process exports 100 of them, another
one all, and each says its largest resident set. The difference is to be below 100 MB. The store is
read without the checks of the command: they would find that it has episodes twice.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.repeated_store import repeat

from grasp_factory.core.text_format import table
from grasp_factory.writers.exporters import EXPORTERS

FEW = 100
PEAK = """
import re, sys
from grasp_factory.dataset.dataset import Dataset
dataset = Dataset(sys.argv[1])
dataset.export(sys.argv[2], sys.argv[3], dataset.committed[: int(sys.argv[4])])
print(int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) // 1024)
"""
"""Prints the largest resident set; ``ru_maxrss`` may be that of the process that started it."""


def peak_mb(store: Path, name: str, out: Path, rows: int) -> int:
    """Return the largest resident set of a process that exports the first rows, MB."""
    words = [sys.executable, "-c", PEAK, str(store), name, str(out), str(rows)]
    found = subprocess.run(words, check=True, capture_output=True, text=True)
    shutil.rmtree(out)
    return int(found.stdout)


def main() -> None:
    """Measure, and print a line for each format."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("store", type=Path)
    parser.add_argument("formats", nargs="*", default=list(EXPORTERS), metavar="FORMAT")
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--folder", type=Path, default=None)
    chosen = parser.parse_args()
    lines: list[tuple[str, ...]] = [("format", f"MB of {FEW}", f"MB of {chosen.rows}")]
    with tempfile.TemporaryDirectory(dir=chosen.folder or chosen.store.parent) as folder:
        store, out = Path(folder) / "many.zarr", Path(folder) / "out"
        repeat(chosen.store, store, chosen.rows)
        for name in chosen.formats:
            peaks = [peak_mb(store, name, out, rows) for rows in (FEW, chosen.rows)]
            lines.append((name, *map(str, peaks)))
            print(table(lines, right=(1, 2)), end="\n\n", flush=True)


if __name__ == "__main__":
    main()
