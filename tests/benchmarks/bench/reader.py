"""Random access: one episode's first image, its depth and its label, from a warm cache.

Three ways to the same content, in turn for each episode: the store, the article's own files (PNG,
.npy, .npy), and the same with the image as .npy as well, which spares the reader all decoding.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import median
from typing import Any

import cv2
import numpy as np
from benchmarks.bench import article
from benchmarks.bench.factory import config_of
from benchmarks.bench.score import Score, Settings, Stopwatch, peak_bytes

from grasp_factory import Dataset, generate

PASSES = 5
"""Over all episodes, each in another order; the first warms the cache and does not count."""

Read = Callable[[int], Any]


def measure(settings: Settings) -> Score:
    """Make both datasets, then read them; ``details`` are seconds an episode, and rates."""
    with tempfile.TemporaryDirectory() as place:
        store, files = Path(place, "ds.zarr"), Path(place, "files")
        generate(config_of(settings), settings.episodes, store, workers=1)
        article.make(files, settings.episodes, settings)
        for index in range(settings.episodes):
            np.save(files / "rgb" / f"before_{index}.npy", _from_files(files, index, ".png")[0])
        dataset = Dataset(store)
        with Stopwatch() as watch:
            details = {
                **_random_access(
                    {
                        "store": lambda i: _from_store(dataset, i),
                        "png": lambda i: _from_files(files, i, ".png"),
                        "npy": lambda i: _from_files(files, i, ".npy"),
                    },
                    settings.episodes,
                ),
                "iter_blocks_rate": _rate(_in_blocks(dataset), settings.episodes),
                "getitem_rate": _rate((dataset[i] for i in dataset.committed), settings.episodes),
            }
    return Score(
        episodes=settings.episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(),
        details=details,
    )


def _from_store(dataset: Dataset, index: int) -> tuple[Any, ...]:
    return (
        dataset.image(index, "front", "rgb", 0),
        dataset.image(index, "front", "depth", 0),
        dataset.value(index, "success"),
    )


def _from_files(files: Path, index: int, image: str) -> tuple[Any, ...]:
    path = files / "rgb" / f"before_{index}{image}"
    return (
        cv2.imread(str(path)) if image == ".png" else np.load(path),
        np.load(files / "depth" / f"depth_before_{index}.npy"),
        np.load(files / f"label_{index}.npy", allow_pickle=True).item()["success"],
    )


def _random_access(ways: dict[str, Read], episodes: int) -> dict[str, float]:
    """Return the median seconds of each way over all passes but the first."""
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    rng = np.random.default_rng(0)
    for turn in range(PASSES):
        for index in rng.permutation(episodes).tolist():
            for name, read in ways.items():
                start = time.perf_counter()
                read(index)
                if turn:
                    seconds[name].append(time.perf_counter() - start)
    return {name: median(found) for name, found in seconds.items()}


def _in_blocks(dataset: Dataset) -> Iterable[Any]:
    for _, episodes in dataset.iter_blocks():
        yield from episodes


def _rate(episodes: Iterable[Any], count: int) -> float:
    with Stopwatch() as watch:
        for _ in episodes:
            pass
    return count / watch.seconds
