"""How a store of a million rows reads: makes one, measures it, removes it.

    PYTHONPATH=tests python -m benchmarks.bench_scale [--rows 1000000] [--folder DIR] [--keep]

The schema is the real one, the images are tiny. A few hundred blocks are written by the real
writer and linked under all other numbers, so that episodes repeat; the coordinator's own packing
makes the packed segments. Once a segment is packed, only the names of its commit markers and of
the arrays in ``LINKED`` stay: 125,000 names for each of them, where a whole store has as many for
every array. No measurement opens the others.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.fake_episodes import JOINTS, make_rows, small_config

from grasp_factory.core import schema
from grasp_factory.core.place import place_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.column_segments import FOLDER, segments
from grasp_factory.writers.zarr.store import missing_rows, prepare_store

CONFIG = small_config(resolution=(16, 16), block_size=8)
SOURCES = 256
"""Blocks that are written; the others are links to them."""
LINKED = (
    *("episodes/status", "episodes/success", "episodes/spec", "episodes/error"),
    *("cameras/front/rgb", "cameras/front/depth"),
)


def make(path: Path, rows: int) -> None:
    """Make the store at ``path``."""
    prepare_store(path, CONFIG, JOINTS, rows, {})
    blocks = -(-rows // CONFIG.block_size)
    arrays = [path / field.path for field in schema.expand(CONFIG)]
    started = time.monotonic()
    sources = min(SOURCES, blocks - 1)  # the last block may be cut short
    for block in (*range(sources), blocks - 1):
        ZarrWriter(path).write_block(block, make_rows(CONFIG, block, rows))
    print(f"wrote {sources + 1} blocks in {time.monotonic() - started:.1f} s", flush=True)
    packed = 0.0
    for first in range(0, blocks - 1, segment_packing.SEGMENT_BLOCKS):
        stop = min(first + segment_packing.SEGMENT_BLOCKS, blocks - 1)
        for array in arrays:
            link(array, range(max(first, sources), stop), sources)
        started = time.monotonic()
        segment_packing.pack(path)
        packed += time.monotonic() - started
        if stop - first == segment_packing.SEGMENT_BLOCKS:
            for array in arrays:
                if str(array.relative_to(path)) not in LINKED:
                    unlink(array, range(max(first, sources), stop))
    count = len(segments(place_of(path)))
    size = sum(segment.file.stat().st_size for segment in segments(place_of(path)))
    each = packed / max(1, count)
    print(f"packed {count} segments, {size / 1e6:.0f} MB, {each:.2f} s each", flush=True)


def link(array: Path, blocks: range, sources: int) -> None:
    """Link blocks of an array to its source blocks."""
    tails = {file.name.partition(".")[0]: file.name for file in array.iterdir()}
    for block in blocks:
        number, dot, tail = tails[str(block % sources)].partition(".")
        os.link(array / f"{number}{dot}{tail}", array / f"{block}{dot}{tail}")


def unlink(array: Path, blocks: range) -> None:
    """Remove the links of blocks."""
    dims = ".0" * (len(json.loads((array / "zarr.json").read_bytes())["shape"]) - 1)
    for block in blocks:
        (array / f"{block}{dims}").unlink()


def forget(path: Path) -> None:
    """Drop the packed segments from the page cache."""
    for segment in segments(place_of(path)):
        with Path(str(segment.file)).open("rb") as file:
            os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def measure(path: Path) -> dict[str, float]:
    """Return seconds by figure, in this process, which has imported all that they need."""
    out: dict[str, float] = {}

    def clock(name: str, function: Callable[[], Any]) -> Any:
        started = time.perf_counter()
        result = function()
        out[name] = time.perf_counter() - started
        return result

    dataset = clock("open", lambda: Dataset(path))
    found = clock("filter on two columns", lambda: dataset.where(success=True, policy="uniform"))
    out["open and filter"] = out["open"] + out["filter on two columns"]
    rows = np.random.default_rng(0).choice(found.indices, 200)

    def look(i: int) -> None:
        dataset.image(i, "front", "rgb", 0)
        dataset.image(i, "front", "depth", 0)
        dataset.value(i, "success")

    clock(
        "where, split, shuffle, ten rows as a table",
        lambda: found.split("test").shuffle(1)[:10].to_pandas(["success"]),
    )
    clock("a column of numbers", lambda: dataset.column("object_mass"))
    clock("rgb, depth and label of one of 200 rows", lambda: [look(int(i)) for i in rows])
    out["rgb, depth and label of one of 200 rows"] /= len(rows)
    clock("what is missing", lambda: missing_rows(path))
    clock("info", lambda: summarise(dataset))
    return out


def in_a_fresh_process(path: Path) -> dict[str, float]:
    """Return what ``measure`` returns there."""
    command = [sys.executable, __file__, "--measure", str(path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout))


def main() -> None:
    """Make, measure, print, remove."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--measure", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measure(arguments.measure)))
        return
    folder = Path(tempfile.mkdtemp(prefix="scale-", dir=arguments.folder))
    path = folder / "scale.zarr"
    try:
        make(path, arguments.rows)
        forget(path)
        cold = in_a_fresh_process(path)
        warm = [in_a_fresh_process(path) for _ in range(5)]
        print(f"{'figure':45}{'warm, median of 5':>20}{'first':>12}")
        for name in cold:
            median = statistics.median(run[name] for run in warm)
            print(f"{name:45}{1e3 * median:>17.1f} ms{1e3 * cold[name]:>9.1f} ms")
        packed = sum(segment.file.stat().st_size for segment in segments(place_of(path)))
        print(f"{len(list((path / FOLDER).iterdir()))} files, {packed / 1e6:.0f} MB packed")
    finally:
        if not arguments.keep:
            shutil.rmtree(folder)


if __name__ == "__main__":
    main()
