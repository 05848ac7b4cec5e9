"""How long a snapshot of 100,000 rows takes, and a comparison of two.

    PYTHONPATH=tests python -m benchmarks.bench_versions [--rows 100000] [--block 8] [--folder DIR]

The store has the real schema. Of its arrays, only the columns that a snapshot reads are written,
with random checksums, in the real files of each block.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.fake_episodes import JOINTS, small_config

from grasp_factory.core import schema
from grasp_factory.core.place import place_of
from grasp_factory.curation.versions import compare, take_snapshot
from grasp_factory.dataset.snapshots import SnapshotFolder, open_version
from grasp_factory.writers.zarr.encoding import packed_chunk
from grasp_factory.writers.zarr.layout import ZSTD_LEVEL, block_files
from grasp_factory.writers.zarr.store import prepare_store

COLUMNS = (schema.CHECKSUM, schema.DIGESTS, schema.STATUS)


def make(path: Path, rows: int, block_size: int, first: int = 0) -> None:
    """Make, or grow, a store whose rows from ``first`` on are new."""
    config = small_config(block_size=block_size)
    prepare_store(path, config, JOINTS, rows, {})
    rng, width = np.random.default_rng(first), len(schema.digested(schema.expand(config)))
    place = place_of(path)
    for block in range(first // block_size, -(-rows // block_size)):
        texts = np.array([rng.bytes(32).hex() for _ in range(block_size)], object)
        digests = rng.integers(0, 2**32, (block_size, width), np.uint32)
        status = np.ones(block_size, np.uint8)
        status[max(0, rows - block * block_size) :] = 0
        for field, values in zip(COLUMNS, (texts, digests, status), strict=True):
            (file,) = block_files(place, field, block, range(block_size))
            file.write(packed_chunk(values, ZSTD_LEVEL))


def clock(what: str, function: Callable[[], Any], times: int = 5) -> None:
    """Print the least time of several runs, and the least time of the processor."""
    wall, cpu = [], []
    for _ in range(times):
        started, used = time.perf_counter(), time.process_time()
        function()
        wall.append(time.perf_counter() - started)
        cpu.append(time.process_time() - used)
    print(
        f"{what:20}{1e3 * min(wall):9.1f} ms{1e3 * min(cpu):9.1f} ms of the processor", flush=True
    )


def main() -> None:
    """Make, measure, print, remove."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=100_000)
    parser.add_argument("--block", type=int, default=8)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="versions-", dir=given.folder))
    path, beside = folder / "s.zarr", folder / "s.zarr.snapshots"
    try:
        make(path, given.rows, given.block)

        def first() -> None:
            shutil.rmtree(beside, ignore_errors=True)
            take_snapshot(path, "first")

        print(f"rows {given.rows}, blocks of {given.block}")
        clock("first snapshot", first)
        size = sum(file.stat().st_size for file in beside.rglob("*") if file.is_file())
        print(f"{'bytes a row':20}{size / given.rows:9.1f}")
        clock("unchanged", lambda: take_snapshot(path, "again"))
        whole = given.rows // given.block * given.block
        make(path, given.rows + given.rows // 2, given.block, first=whole)
        clock("grown by half", lambda: take_snapshot(path, "grown"), times=1)
        ids = [name for name, _ in SnapshotFolder.of(path).history()]
        pair = [f"{path}@{name}" for name in (ids[1], ids[0])]
        clock("diff, grown", lambda: compare(*map(open_version, pair)))
        other = folder / "o.zarr"
        make(other, given.rows, given.block, first=given.block)  # all rows but a block's are others
        make(other, given.block, given.block)
        changed = [pair[0], f"{other}@{take_snapshot(other, 'other').id}"]
        clock("diff, all changed", lambda: compare(*map(open_version, changed)))
        clock("diff --arrays", lambda: compare(*map(open_version, changed), arrays=True))
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
