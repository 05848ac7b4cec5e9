"""The real thing: ``grasp_factory.generate``, from the call to the summary."""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

from benchmarks.bench.score import WARM_UP_EPISODES, Score, Settings, Stopwatch, peak_bytes

from grasp_factory import FactoryConfig, generate
from grasp_factory.factory.block_job import Made
from grasp_factory.factory.run_request import resolve_request

WARM_UP_SEED = 1
"""Not the seed that is measured: nothing of its episodes is met again."""


def config_of(settings: Settings, physics: str = "default", seed: int = 0) -> FactoryConfig:
    """Return the default config with images of the size that is asked for."""
    flags = {
        "resolution": [settings.width, settings.height],
        "seed": seed,
        "physics": physics,
    }
    return resolve_request({}, flags).config


def measure_one(settings: Settings) -> Score:
    """One worker, which is this process, with the default physics."""
    return _measure(settings, workers=1)


def measure_fast(settings: Settings) -> Score:
    """One worker with ``--physics fast``."""
    return _measure(settings, workers=1, physics="fast")


def measure_two(settings: Settings) -> Score:
    """Two workers: the whole call counts, the start of their processes too."""
    return _measure(settings, workers=2)


def _measure(settings: Settings, workers: int, physics: str = "default") -> Score:
    config = config_of(settings, physics)
    stamps: dict[int, float] = {}

    def stamp(made: Made) -> None:
        stamps[made.index] = time.perf_counter()

    with tempfile.TemporaryDirectory() as place:
        warm = config_of(settings, physics, WARM_UP_SEED)
        generate(warm, WARM_UP_EPISODES, Path(place, "warm.zarr"), workers=1)
        with Stopwatch() as watch:
            summary = generate(
                config, settings.episodes, Path(place, "ds.zarr"), workers, on_episode=stamp
            )
        end = time.perf_counter()
    who = resource.RUSAGE_SELF if workers == 1 else resource.RUSAGE_CHILDREN
    return Score(
        episodes=settings.episodes,
        seconds=watch.seconds,
        cpu_seconds=watch.cpu_seconds,
        peak_bytes=peak_bytes(who),
        stored_bytes=summary.store.bytes,
        details={"running_rate": _running_rate(stamps, workers, config.block_size, end)},
    )


def _running_rate(stamps: dict[int, float], workers: int, block_size: int, end: float) -> float:
    """Return episodes per second from when every worker has made its first one."""
    firsts = [worker * block_size for worker in range(workers)]
    start = max(stamps[index] for index in firsts if index in stamps)
    return sum(moment > start for moment in stamps.values()) / (end - start)
