"""How quickly episodes are read, and what other codecs would give, on a store of real images.

    grasp-factory generate --n 24 --out grasps.zarr
    PYTHONPATH=tests python -m benchmarks.bench_reading grasps.zarr [--zarrs]

Everything runs in one process and one thread, from a warm page cache, the readers in turn.
"""

from __future__ import annotations

import argparse
import functools
import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import zarr
from numcodecs import blosc, zstd
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset

ROUNDS = 7
CODECS: Mapping[str, tuple[Callable[..., bytes], Callable[..., Any]]] = {
    "zstd 1": (lambda image: zstd.compress(image, 1), zstd.decompress),
    "zstd 3 (the store's)": (lambda image: zstd.compress(image, 3), zstd.decompress),
    **{
        f"blosc {name} {level}{', shuffled' if shuffle else ''}": (
            lambda image, n=name, c=level, s=shuffle: blosc.compress(image, n.encode(), c, s),
            blosc.decompress,
        )
        for name, level, shuffle in (
            *(("lz4", 5, 0), ("lz4", 5, 1), ("lz4hc", 9, 0)),
            *(("zstd", 1, 1), ("zstd", 3, 1)),
        )
    },
}
"""Name to what compresses an array, and what decompresses bytes into one."""


def milliseconds(function: Callable[[Any], Any], items: Iterable[Any]) -> float:
    """Return the time of a call."""
    items, started = list(items), time.perf_counter()
    for item in items:
        function(item)
    return 1e3 * (time.perf_counter() - started) / len(items)


def compare_readers(dataset: Dataset, camera: str) -> None:
    """Print the time for RGB and depth before the attempt, and the label, of a random episode."""
    arrays = dataset.arrays()
    paths = [f"cameras/{camera}/rgb", f"cameras/{camera}/depth", "episodes/success"]
    rgb, depth, label = (arrays[path] for path in paths)
    rows = np.random.default_rng(0).permutation(np.repeat(dataset.committed, 4)).tolist()
    with tempfile.TemporaryDirectory() as folder:
        for i in dataset.committed.tolist():
            image = dataset.image(i, camera, "rgb", 0)
            np.save(f"{folder}/{i}-rgb.npy", image)
            cv2.imwrite(f"{folder}/{i}.png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
            np.save(f"{folder}/{i}-depth.npy", dataset.image(i, camera, "depth", 0))
            np.save(f"{folder}/{i}-label.npy", dataset.value(i, "success"))
        files = {
            "three np.load": lambda i: np.load(f"{folder}/{i}-rgb.npy"),
            "the article's: PNG and two np.load": lambda i: cv2.imread(f"{folder}/{i}.png"),
        }
        readers: dict[str, Callable[[int], Any]] = {
            "Dataset": lambda i: (
                dataset.image(i, camera, "rgb", 0),
                dataset.image(i, camera, "depth", 0),
                dataset.value(i, "success"),
            ),
            "zarr.Array": lambda i: (rgb[i, 0], depth[i, 0], label[i]),
            **{
                name: lambda i, first=first: (
                    first(i),
                    np.load(f"{folder}/{i}-depth.npy"),
                    np.load(f"{folder}/{i}-label.npy"),
                )
                for name, first in files.items()
            },
        }
        times: dict[str, list[float]] = {name: [] for name in readers}
        for _ in range(ROUNDS):
            for name, read in readers.items():
                times[name].append(milliseconds(read, rows))
    print(f"{'RGB, depth and label of one episode':40}{'median':>9}{'least':>9}")
    for name, each in times.items():
        print(f"{name:40}{statistics.median(each):>6.2f} ms{min(each):>6.2f} ms")


def decode_into(decode: Callable[..., Any], like: NDArray[Any], data: bytes) -> None:
    """Decompress into memory that is as new as a reader's."""
    decode(data, np.empty_like(like))


def compare_codecs(dataset: Dataset, camera: str) -> None:
    """Print size and times of each codec, for images before the attempt."""
    blosc.set_nthreads(1)
    print(f"\n{'codec: size, encode, decode of':30}{'RGB':^30}{'depth':^30}")
    for name, (encode, decode) in CODECS.items():
        line = f"{name:30}"
        for kind in ("rgb", "depth"):
            images = list(dataset.images(dataset.committed.tolist(), camera, kind, 0))
            packed = [encode(image) for image in images]
            size = statistics.mean(map(len, packed)) / 1e3
            encoding = min(milliseconds(encode, images) for _ in range(3))
            into = functools.partial(decode_into, decode, images[0])
            decoding = min(milliseconds(into, packed) for _ in range(ROUNDS))
            line += f"{size:>7.1f} kB{encoding:>7.2f} ms{decoding:>6.2f} ms "
        print(line)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("--zarrs", action="store_true", help="zarr.Array uses the zarrs pipeline")
    arguments = parser.parse_args()
    if arguments.zarrs:
        import zarrs  # noqa: F401  # an optional package: it must be there

        zarr.config.set({"codec_pipeline.path": "zarrs.ZarrsCodecPipeline"})
    cv2.setNumThreads(1)
    dataset = Dataset(arguments.store)
    camera = next(iter(dataset.config.cameras))
    compare_readers(dataset, camera)
    compare_codecs(dataset, camera)


if __name__ == "__main__":
    main()
