"""Pilot blocks: some blocks of a run, made by the run's own code in a temporary store."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import resource
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasp_factory.core.executors import Executor, SendMessage
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import StoreSummary, summarise
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.block_job import Begun, BlockJob, Committed, Made
from grasp_factory.factory.block_maker import BlockMaker
from grasp_factory.factory.generate import origin_attributes
from grasp_factory.factory.name_check import check_names
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.zarr.files import cannot_write, locate
from grasp_factory.writers.zarr.store import prepare_store

ENOUGH = 0.05
"""Pilots end when the standard error of the predicted time is below this share of it. A run may
miss its forecast by three times that."""
FEWEST, MOST = 16, 256
"""Limits of the number of pilot episodes. Fewer do not show their spread. The time of an attempt
varies by some 60 % of its mean, so 144 are enough for a run of any length."""
_ENOUGH_MARK = "enough"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pilot:
    """A block that was made. Times are in seconds on the clock that all processes share."""

    block: int
    worker: int
    started: float
    ended: float
    episodes: tuple[float, ...]
    """Seconds of each episode, including its share of the time to write the block."""
    peak_bytes: int
    """Largest memory of the worker so far."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotResult:
    """The result of the pilots. The times are those that a run of any length needs once."""

    pilots: tuple[Pilot, ...]
    prepare_seconds: float
    """Time to create the empty store."""
    start_seconds: float
    """From the start of a worker's process to its first block; next to 0 without processes."""
    finish_seconds: float
    """From the end of the last block to the summary."""
    empty_bytes: int
    store: StoreSummary


def run_pilot_blocks(
    request: Request,
    executor: Executor,
    length: int,
    sizes: Mapping[int, int],
    on_episode: Callable[[Made], None],
) -> PilotResult:
    """Make blocks of a run, drawn at random, until the estimate is precise enough.

    The requested number of workers writes next to the run's own store, so that the times include
    the cost of its disk and the workers' effect on each other.

    Args:
        request: the run.
        executor: runs the blocks.
        length: number of rows of the run's store.
        sizes: episodes of each block that is missing.
        on_episode: called for each pilot as it is made.

    Raises:
        StoreMismatchError: if nothing can be written there.
        StoreError: if the disk fails.
        WorkerError: if a worker died.
    """
    config, pilots, to_make = request.config, list[Pilot](), sum(sizes.values())
    most = max(request.workers, math.ceil(MOST / config.block_size))
    drawn = np.random.default_rng(0).permutation(list(sizes))[:most].tolist()
    with _default_folder(request.out) as place:
        store, begun = place / "pilots.zarr", time.monotonic()
        robot = check_names(config)
        facts, files = origin_attributes(config, robot), embedded_assets.packed(config)
        prepare_store(store, config, len(robot.arm_joints), length, facts, carried=files)
        prepared = time.monotonic()
        empty_bytes = summarise(Dataset(store)).bytes

        def hear(message: Made | Pilot) -> None:
            if isinstance(message, Made):
                on_episode(message)
                return
            pilots.append(message)
            if is_enough(pilots, to_make):
                (place / _ENOUGH_MARK).touch()

        called = time.monotonic()
        with contextlib.closing(BlockMaker(config, store)) as make:
            task = functools.partial(_make_pilot, make=make, enough=place / _ENOUGH_MARK)
            executor.run(task, drawn, hear)
        return PilotResult(
            pilots=tuple(pilots),
            prepare_seconds=prepared - begun,
            start_seconds=_mean_start(pilots) - called,
            store=summarise(Dataset(store)),
            finish_seconds=time.monotonic() - max(pilot.ended for pilot in pilots),
            empty_bytes=empty_bytes,
        )


def episode_seconds(pilots: Sequence[Pilot]) -> list[float]:
    """Return the seconds of all episodes."""
    return [seconds for pilot in pilots for seconds in pilot.episodes]


def relative_error(pilots: Sequence[Pilot], to_make: int) -> float:
    """Return the standard error of the time of a run, as a share of it.

    It is 0 if the pilots are the whole run, and otherwise infinite for fewer than two episodes.
    """
    seconds = np.array(episode_seconds(pilots))
    if len(seconds) < 2:
        return 0.0 if len(seconds) == to_make else math.inf
    share = max(0.0, 1.0 / len(seconds) - 1.0 / to_make)
    return float(seconds.std(ddof=1) / seconds.mean() * math.sqrt(share))


def is_enough(pilots: Sequence[Pilot], to_make: int) -> bool:
    """Return whether the estimate is precise enough, so that no more pilots are needed."""
    made = sum(len(pilot.episodes) for pilot in pilots)
    return made >= FEWEST and relative_error(pilots, to_make) < ENOUGH


def _make_pilot(block: int, report: SendMessage, *, make: BlockMaker, enough: Path) -> None:
    """Make a block unless there are enough; runs in a worker."""
    if enough.exists():
        return
    moments = [time.monotonic()]

    def count(message: Begun | Made | Committed) -> None:
        if isinstance(message, Made):
            moments.append(time.monotonic())
            report(message)

    make(BlockJob(block=block), count)
    ended = time.monotonic()
    alone = np.diff(moments)
    each = alone + (ended - moments[-1]) / len(alone)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # Linux counts in kB
    report(
        Pilot(
            block=block,
            worker=os.getpid(),
            started=moments[0],
            ended=ended,
            episodes=tuple(each.tolist()),
            peak_bytes=peak,
        )
    )


def _mean_start(pilots: Sequence[Pilot]) -> float:
    """Return the mean of the times at which the workers began."""
    firsts: dict[int, float] = {}
    for pilot in sorted(pilots, key=lambda pilot: pilot.started):
        firsts.setdefault(pilot.worker, pilot.started)
    return sum(firsts.values()) / len(firsts)


@contextlib.contextmanager
def _default_folder(out: Path) -> Iterator[Path]:
    """Yield a folder on the disk of ``out``, which is removed at the end."""
    target = locate(out)
    with contextlib.ExitStack() as stack:
        try:
            folder = scratch_folder(target.parent, f"{target.name}.pilots")
            place = stack.enter_context(folder)
        except OSError as error:
            raise cannot_write(out, error) from None
        yield place
