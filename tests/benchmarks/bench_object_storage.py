"""How quickly a store in object storage is read, against the same store on the disk.

    bin/ceph-rgw FOLDER && . FOLDER/environment
    grasp-factory generate --n 768 --workers 2 --resolution 640x480 --out grasps.zarr
    PYTHONPATH=tests python -m benchmarks.bench_object_storage grasps.zarr

The server is what the environment names. The store is packed, once on the disk and once there. Both
are read in turns, in processes that have imported everything. The page cache is warm.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from support.object_server import make_bucket
from torch.utils.data import DataLoader
from torch.utils.data import Dataset as TorchDataset

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.curation.pack import pack_store
from grasp_factory.curation.upload import pack_there
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.torch import GraspDataset, GraspStream

BATCH, WORKERS = 64, 2
EPOCHS = (1, 5)
"""Of trainings with the file of examples that ``GraspDataset`` has by default."""
EPISODE_MS, INFO_S, LOADER_RATIO = 5.0, 0.5, 0.6
"""Bounds: a random episode with warm caches, the first ``info``, the loader against the disk."""


def first_info(store: str) -> float:
    """Return the seconds that a new process takes for the counts of a store, without imports."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return float(pool.apply(_info_seconds, (store,)))


def _info_seconds(store: str) -> float:
    started = time.perf_counter()
    summarise(Dataset(store))
    return time.perf_counter() - started


def episode_ms(store: str, reads: int = 200) -> float:
    """Return the median time for RGB, depth and label of a random episode, caches warm."""
    dataset = Dataset(store)
    camera = next(iter(dataset.config.cameras))

    def read(row: int) -> None:
        dataset.image(row, camera, "rgb", 0)
        dataset.image(row, camera, "depth", 0)
        dataset.value(row, "success")

    for row in dataset.committed[:: max(1, len(dataset.committed) // 64)].tolist():
        read(row)
    times = []
    for row in np.random.default_rng(0).choice(dataset.committed, reads).tolist():
        started = time.perf_counter()
        read(row)
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times)


class Feed:
    """A loader of one epoch after another, whose workers stay."""

    def __init__(self, store: str, *, is_stream: bool = False, **settings: Any) -> None:
        examples = GraspDataset(store, **settings)
        self._loader = _loader(
            GraspStream(examples) if is_stream else examples, shuffle=not is_stream
        )

    def speed(self) -> float:
        """Return the examples per second of an epoch, whose workers have started."""
        started = time.perf_counter()
        count = sum(len(batch["success"]) for batch in self._loader)
        return count / (time.perf_counter() - started)


def _loader(examples: Any, *, shuffle: bool) -> DataLoader[Any]:
    return DataLoader(
        examples,
        shuffle=shuffle or None,
        batch_size=BATCH,
        num_workers=WORKERS,
        persistent_workers=True,
        multiprocessing_context="spawn",
    )


class Gated(TorchDataset[Any]):
    """Examples that each worker begins to read when all workers have started."""

    def __init__(self, examples: GraspDataset, gate: Any) -> None:
        self._examples, self._gate, self._is_open = examples, gate, False

    def __len__(self) -> int:
        return len(self._examples)

    def __getitems__(self, indices: Sequence[int]) -> list[Any]:
        if not self._is_open:
            self._gate.wait()
            self._is_open = True
        return self._examples.__getitems__(indices)


def kept_speed(store: str, epochs: int) -> float:
    """Return the examples per second of the first epochs of a training, whose workers have started.

    ``GraspDataset`` is as it is by default, so that it keeps examples in a file.
    """
    gate = multiprocessing.get_context("spawn").Barrier(WORKERS + 1)
    loader = _loader(Gated(GraspDataset(store), gate), shuffle=True)
    first = iter(loader)
    gate.wait()
    started = time.perf_counter()
    count = sum(len(batch["success"]) for batch in first)
    for _ in range(epochs - 1):
        count += sum(len(batch["success"]) for batch in loader)
    return count / (time.perf_counter() - started)


def in_turns(what: str, here: Callable[[], float], there: Callable[[], float], rounds: int) -> None:
    """Print the speeds of both loaders, and their ratio in each round."""
    pairs = [(here(), there()) for _ in range(rounds)]
    near, far = (statistics.median(each) for each in zip(*pairs, strict=True))
    ratios = sorted(b / a for a, b in pairs)
    print(
        f"{what:24}{near:8.0f}/s on the disk{far:8.0f}/s there, ratio "
        f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}),"
        f" bound {LOADER_RATIO}",
        flush=True,
    )


def main() -> None:
    """Send, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--bucket", default="benchmark")
    parser.add_argument("--block", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    make_bucket(os.environ["AWS_ENDPOINT_URL"], given.bucket)
    with tempfile.TemporaryDirectory() as folder:
        near = Path(folder) / "near.zarr"
        pack_store(given.store, near, given.block)
        far = f"s3://{given.bucket}/{given.block}/{Dataset(near).config.sha256()[:12]}.zarr"
        pack_there(given.store, store_path(far), given.block)
        stores = str(near), far
        rows = len(Dataset(near))
        print(f"{rows} episodes, blocks of {given.block}, {os.environ['AWS_ENDPOINT_URL']}")
        infos = [[first_info(store) for store in stores] for _ in range(given.rounds)]
        for name, times in zip(("disk", "there"), zip(*infos, strict=True), strict=True):
            print(f"first info, {name:6}{statistics.median(times):8.3f} s, bound {INFO_S} s")
        for name, store in zip(("disk", "there"), stores, strict=True):
            print(f"episode, {name:6}{episode_ms(store):11.2f} ms, bound {EPISODE_MS} ms")
        for kind, is_stream in (("GraspStream", True), ("GraspDataset, shuffled", False)):
            feeds = [Feed(store, is_stream=is_stream, keep_bytes=0) for store in stores]
            for feed in feeds:
                feed.speed()
            in_turns(kind, feeds[0].speed, feeds[1].speed, given.rounds)
        for epochs in EPOCHS:
            kept = [partial(kept_speed, store, epochs) for store in stores]
            in_turns(f"shuffled, kept, {epochs} epochs", kept[0], kept[1], given.rounds)


if __name__ == "__main__":
    main()
