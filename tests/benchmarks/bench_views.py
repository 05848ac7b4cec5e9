"""How quickly views of a million rows are chosen and read: makes a store, measures, removes it.

    PYTHONPATH=tests python -m benchmarks.bench_views [--rows 1000000] [--folder DIR]

The real writer writes one block of 976 rows; the others are hard links to it under their own
numbers, so that episodes repeat. The columns and their files are those of a real store, and the
coordinator's own packing makes the packed segment.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.bench_scale import link
from support.fake_episodes import JOINTS, make_rows, small_config

from grasp_factory import Dataset
from grasp_factory.core import schema
from grasp_factory.writers import ZarrWriter
from grasp_factory.writers.zarr import segment_packing
from grasp_factory.writers.zarr.store import prepare_store

CONFIG = small_config(resolution=(16, 16), block_size=976)
TIMES = 5


def make(path: Path, rows: int) -> None:
    """Make a store of whole blocks at ``path``, with at least so many rows."""
    blocks = -(-rows // CONFIG.block_size)
    prepare_store(path, CONFIG, JOINTS, blocks * CONFIG.block_size, {})
    ZarrWriter(path).write_block(0, make_rows(CONFIG, 0, CONFIG.block_size))
    for field in schema.expand(CONFIG):
        link(path / field.path, range(1, blocks), 1)
    segment_packing.pack(path)


def few(dataset: Dataset) -> Dataset:
    """Return ten random episodes of a policy and a split."""
    return dataset.where(success=False, policy="top_down").split("test").shuffle(1)[:10]


QUESTIONS: Mapping[str, Callable[[Dataset], Any]] = {
    "where, split, shuffle, [:10], to_pandas": lambda ds: few(ds).to_pandas(),
    "where on two columns": lambda ds: ds.where(success=False, policy="top_down"),
    "split": lambda ds: ds.split("test"),
    "shuffle": lambda ds: ds.shuffle(1),
    "select every row by index": lambda ds: ds.select(np.arange(len(ds))),
    "a mask of a column": lambda ds: ds[ds["object_mass"] < 0.1],
    "filter by a function of a column": lambda ds: ds.filter(lambda m: m < 0.1, "object_mass"),
    "a column of words": lambda ds: ds["outcome"],
    "to_pandas of four columns": lambda ds: ds.to_pandas(
        ["outcome", "success", "policy", "lift_height"]
    ),
    "print": repr,
    "in a notebook": lambda ds: ds._repr_html_(),
}


def measure(path: Path) -> dict[str, list[tuple[float, float]]]:
    """Return the seconds of the clock and of the processor that each question takes.

    It is asked ``TIMES`` times of a newly opened store.
    """
    few(Dataset(path)).to_pandas()  # imports pandas
    out: dict[str, list[tuple[float, float]]] = {}
    for name, question in QUESTIONS.items():
        for _ in range(TIMES):
            dataset = Dataset(path)
            started = time.perf_counter(), time.process_time()
            question(dataset)
            took = time.perf_counter() - started[0], time.process_time() - started[1]
            out.setdefault(name, []).append(took)
    return out


def main() -> None:
    """Make, measure, print, remove."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()))
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="views-", dir=arguments.folder))
    try:
        make(folder / "views.zarr", arguments.rows)
        print(f"{len(Dataset(folder / 'views.zarr')):,} rows")
        for name, seconds in measure(folder / "views.zarr").items():
            clock, processor = (
                1e3 * statistics.median(each) for each in zip(*seconds, strict=True)
            )
            print(f"{name:45}{clock:6.0f} ms, of the processor {processor:6.0f} ms")
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
