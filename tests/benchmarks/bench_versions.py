"""How long a snapshot of 100,000 rows takes, and a comparison of two.

    PYTHONPATH=tests python -m benchmarks.bench_versions [--rows 100000] [--block 8] [--folder DIR]

The store has the real schema. Of its arrays, only the columns that a snapshot reads are written,
with random checksums, in the real files of each block.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
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


def seconds(function: Callable[[], Any], times: int = 5) -> float:
    """Return the median of several runs."""
    out = []
    for _ in range(times):
        started = time.perf_counter()
        function()
        out.append(time.perf_counter() - started)
    return statistics.median(out)


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
        print(f"first snapshot      {1e3 * seconds(first):9.1f} ms")
        size = sum(file.stat().st_size for file in beside.rglob("*") if file.is_file())
        print(f"bytes a row         {size / given.rows:9.1f}")
        print(f"unchanged           {1e3 * seconds(lambda: take_snapshot(path, 'again')):9.1f} ms")
        whole = given.rows // given.block * given.block
        make(path, given.rows + given.rows // 2, given.block, first=whole)
        started = time.perf_counter()
        take_snapshot(path, "grown by half")
        print(f"grown by half       {1e3 * (time.perf_counter() - started):9.1f} ms")
        ids = [name for name, _ in SnapshotFolder.of(path).history()]
        pair = [f"{path}@{name}" for name in (ids[1], ids[0])]
        grown = seconds(lambda: compare(*map(open_version, pair)))
        print(f"diff, grown         {1e3 * grown:9.1f} ms")
        other = folder / "o.zarr"
        make(other, given.rows, given.block, first=given.block)  # all rows but a block's are others
        make(other, given.block, given.block)
        name = take_snapshot(other, "other").id
        pair = [pair[0], f"{other}@{name}"]
        changed = seconds(lambda: compare(*map(open_version, pair)))
        print(f"diff, all changed   {1e3 * changed:9.1f} ms")
        arrays = seconds(lambda: compare(*map(open_version, pair), arrays=True))
        print(f"diff --arrays       {1e3 * arrays:9.1f} ms")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
