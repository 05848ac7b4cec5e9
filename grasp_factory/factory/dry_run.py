"""Forecast of a run's time, disk, memory and success from pilots, which are not kept."""

from __future__ import annotations

import heapq
import math
import shutil
import statistics
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.executors import JOBS_PER_PROCESS, Executor, make_executor
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.block_job import Made, shard_rows
from grasp_factory.factory.dry_run_pilots import (
    PilotResult,
    episode_seconds,
    relative_error,
    run_pilot_blocks,
)
from grasp_factory.factory.name_check import check_names
from grasp_factory.factory.platform_check import check_platform
from grasp_factory.factory.plugins import activate, with_plugins
from grasp_factory.factory.run_request import Request
from grasp_factory.simulation.world.connection import check_renderer
from grasp_factory.writers.zarr.store import check_place, missing_rows

Z95 = 1.96
"""Standard deviations about the mean that hold 95 % of a normal distribution."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """Estimates for the missing episodes, from the pilots."""

    pilots: int
    """Number of episodes that were made for the estimates."""
    quarantined: int
    """Number of pilots that are quarantined."""
    seconds: float
    seconds_error: float
    """Standard error of ``seconds``, because of the episodes that were not made."""
    bytes: int
    peak_bytes: int
    """Memory of all workers, if each grows as large as the largest worker of the pilots."""
    success_rate: float | None
    """None if all pilots are quarantined."""
    success_interval: tuple[float, float] | None
    """The 95 % confidence interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """What a run would do, and what it would need."""

    path: str
    asked: int
    already_there: int
    """Of those asked for."""
    to_make: int
    workers: int
    free_bytes: int
    """Free space of the disk."""
    expected: Expected | None
    """None when nothing is to be made."""

    @property
    def fits(self) -> bool:
        """Whether the disk has room."""
        return self.expected is None or self.expected.bytes <= self.free_bytes


def forecast(
    request: Request,
    on_episode: Callable[[Made], None] = lambda made: None,
    executor: Executor | None = None,
) -> Forecast:
    """Make a few blocks of a run, delete them, and return what the run would need.

    Args:
        request: the run.
        on_episode: called for each pilot as it is made.
        executor: the run's executor; None for that of ``generate`` without a timeout.

    Raises:
        UsageError: for what ``generate`` would refuse.
        StoreError: if the existing store is damaged, or the disk fails.
        WorkerError: if a worker died.
    """
    request = replace(request, config=with_plugins(request.config))
    config, size = request.config, request.config.block_size
    target = check_place(request.out, config)
    embedded_assets.unpack(request.out, config)
    activate(config)
    check_names(config)
    check_renderer(config.renderer)
    check_platform(request)
    there = len(Dataset(request.out)) if (target / "zarr.json").exists() else 0
    length = max(there, request.n)
    missing, part = _missing(request, there, length), shard_rows(request)
    wanted = np.intersect1d(missing, part, assume_unique=True)
    counts = np.unique(missing // size, return_counts=True)
    touched = set((wanted // size).tolist())
    sizes = {b: k for b, k in zip(*map(np.ndarray.tolist, counts), strict=True) if b in touched}
    to_make = sum(sizes.values())
    place = target if target.exists() else target.parent
    expected = None
    if sizes:
        how = executor or make_executor(request.workers)
        flight = run_pilot_blocks(request, how, length, sizes, on_episode)
        expected = _expected(flight, sizes, request.workers, is_new=there == 0)
    return Forecast(
        path=str(request.out),
        asked=len(part),
        already_there=len(part) - len(wanted),
        to_make=to_make,
        workers=request.workers,
        free_bytes=shutil.disk_usage(place).free,
        expected=expected,
    )


def _missing(request: Request, there: int, length: int) -> NDArray[np.int64]:
    """Return the missing rows, including the rows by which the store would grow."""
    longer = np.arange(there, length)
    if not there:
        return longer
    own = missing_rows(request.out, quarantined=request.retry_quarantined)
    return np.concatenate([own, longer])


def _expected(
    flight: PilotResult, sizes: Mapping[int, int], workers: int, *, is_new: bool
) -> Expected:
    """Estimate the run from the pilots.

    Args:
        flight: the pilots.
        sizes: episodes of each block that is missing.
        workers: processes.
        is_new: whether there is no store yet, so that its metadata are still to be written.
    """
    made, to_make, store = episode_seconds(flight.pilots), sum(sizes.values()), flight.store
    team = min(workers, len(sizes))
    known = {pilot.block: pilot.ended - pilot.started for pilot in flight.pilots}
    durations = [known.get(block, n * statistics.fmean(made)) for block, n in sizes.items()]
    busy = makespan(durations, team, flight.start_seconds)
    each = (store.bytes - flight.empty_bytes) / len(made)
    return Expected(
        pilots=len(made),
        quarantined=store.quarantined,
        seconds=flight.prepare_seconds + busy + flight.finish_seconds,
        seconds_error=busy * relative_error(flight.pilots, to_make),
        bytes=round(each * to_make) + (flight.empty_bytes if is_new else 0),
        peak_bytes=team * max(pilot.peak_bytes for pilot in flight.pilots),
        success_rate=store.success_rate,
        success_interval=wilson(store.successes, store.committed) if store.committed else None,
    )


def makespan(durations: Iterable[float], workers: int, start_up: float) -> float:
    """Return the seconds that blocks take, each going to the worker that is free first.

    Args:
        durations: of the blocks in their order, seconds.
        workers: how many there are; each is replaced after ``JOBS_PER_PROCESS`` blocks.
        start_up: seconds before a new worker begins its first block.
    """
    free = [(start_up, 0)] * workers
    for seconds in durations:
        moment, done = heapq.heappop(free)
        if done == JOBS_PER_PROCESS:
            moment, done = moment + start_up, 0
        heapq.heappush(free, (moment + seconds, done + 1))
    return max(moment for moment, done in free if done)


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a rate, valid also for few attempts and without any failure."""
    rate, square = successes / n, Z95**2
    center = (rate + square / (2 * n)) / (1 + square / n)
    half = Z95 / (1 + square / n) * math.sqrt(rate * (1 - rate) / n + square / (4 * n * n))
    return max(0.0, center - half), min(1.0, center + half)
