"""The factory: find the missing blocks, make them on an executor, return a summary."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.executors import ExecutorKind, ExecutorSettings, executor_kind, go_on
from grasp_factory.core.executors.process_start import check_main_guard
from grasp_factory.core.object_storage.address import on_disk
from grasp_factory.core.os_errors import adding_how_to_continue
from grasp_factory.core.platforms import FINGERPRINT
from grasp_factory.core.progress import has_bars
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.summary import summarise
from grasp_factory.errors import StoreBusyError
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.block_job import Begun, BlockJob, Committed, Made, shard_rows
from grasp_factory.factory.block_maker import BlockMaker
from grasp_factory.factory.name_check import check_names
from grasp_factory.factory.node_check import node_check
from grasp_factory.factory.platform_check import check_platform, warn_of_other_versions
from grasp_factory.factory.plugins import activate, with_plugins
from grasp_factory.factory.retry_policy import Failures, Losses
from grasp_factory.factory.run_bar import RunBar
from grasp_factory.factory.run_log import RunLog
from grasp_factory.factory.run_records import RunPlan, Summary
from grasp_factory.factory.run_request import (
    EPISODE_TIMEOUT_S,
    EXECUTOR,
    MAX_FAILURES,
    WHOLE,
    Request,
    Shard,
)
from grasp_factory.robots import RobotModel
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.simulation.world.connection import check_renderer
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.lock import ShardLock, StoreLock
from grasp_factory.writers.zarr.segment_packing import is_time_to_pack, pack
from grasp_factory.writers.zarr.store import check_place, missing_rows, prepare_store
from grasp_factory.writers.zarr.writer import QUARANTINED, ZarrWriter


def generate(
    config: FactoryConfig,
    n: int,
    out: Path | str,
    workers: int = 2,
    *,
    executor: str = EXECUTOR,
    shard: Shard = WHOLE,
    episode_timeout: float | None = None,
    max_failures: float = MAX_FAILURES,
    retry_quarantined: bool = False,
    accept_other_platform: bool = False,
    progress: bool | None = None,
    on_start: Callable[[RunPlan], None] = lambda plan: None,
    on_episode: Callable[[Made], None] = lambda made: None,
    on_loss: Callable[[str], None] = lambda text: None,
    on_node: Callable[[str], None] = lambda text: None,
) -> Summary:
    """Make sure that the store at ``out`` holds episodes 0 to ``n`` - 1 of ``config``.

    Existing episodes stay as they are; a run that was stopped continues where it stopped. An
    episode that cannot be made, raises, kills its worker twice or takes too long twice is
    quarantined.

    With more than one worker, or a timeout, call it under ``if __name__ == "__main__":``, like
    all code that spawns processes.

    Args:
        config: decides the episodes' content. A policy, a robot or an object set may be an object
            in a file of the user, such as ``my_file.py:plan``.
        n: the number of episodes that the store must have.
        out: path of the store, which is new or of the same config.
        workers: number of processes; with 1 and no timeout, episodes are made in this process,
            which one of them may then kill. On a cluster it is the number for each node.
        executor: where the processes are, NAME or NAME:ADDRESS. ``local`` is this machine, and
            ``ray`` a cluster whose nodes share the file system of ``out``.
        shard: the part of the store to make; others may make its other parts at the same time.
        episode_timeout: seconds that an episode may take; None for 600 with several workers.
        max_failures: the largest share of quarantined episodes with which the run succeeds.
        retry_quarantined: try episodes again that are already in quarantine.
        accept_other_platform: continue a store that was begun on a platform whose bytes may
            differ; the rows made here record this platform.
        progress: whether to show on stderr how many episodes are made: True for a bar in a terminal
            or a notebook and a line a minute elsewhere, None for the bar alone, False for nothing.
        on_start: called once with the plan, after every check and before the first episode.
        on_episode: called for each episode as it is made; its block is committed later.
        on_loss: called with one line of text when a worker was lost and its block is made again.
        on_node: called with one line of text when a node of a cluster joins, is refused or is lost.

    Raises:
        UsageError: if the request cannot be carried out; nothing has been written.
        StoreError: if the store cannot be written, or another process is writing to it.
        WorkerError: if workers are lost and no episode is to blame; what is committed stays.
        FailuresError: if too many episodes are quarantined to continue; committed blocks stay.
    """
    check_main_guard()
    config = with_plugins(config)
    seconds = EPISODE_TIMEOUT_S if episode_timeout is None else episode_timeout
    request = Request(
        config=config, n=n, workers=workers, out=on_disk(out), shard=shard,
        episode_timeout=seconds, max_failures=max_failures, retry_quarantined=retry_quarantined,
        accept_other_platform=accept_other_platform, executor=executor,
    )  # fmt: skip
    kind, address = executor_kind(request.executor)
    is_watched = episode_timeout is not None
    engine = kind.make(
        ExecutorSettings(
            workers=request.workers, address=address, is_watched=is_watched, tell=on_node
        )
    )
    path, start = request.out, time.monotonic()
    target = check_place(path, config)
    embedded_assets.unpack(path, config)
    activate(config)
    robot = check_names(config)
    check_renderer(config.renderer)
    with adding_how_to_continue(), _lock(request) as lock, RunLog(target, request) as log:
        check_platform(request)
        if lock.is_alone:
            facts, files = origin_attributes(config, robot), embedded_assets.packed(config)
            prepare_store(path, config, len(robot.arm_joints), request.n, facts, carried=files)
            ZarrWriter(path).remove_leftovers()
            lock.share()
        plan = _plan(request)
        on_start(plan)
        if plan.blocks:
            warn_of_other_versions(path)
            log.begin()
            losses = Losses(config.block_size, request.episode_timeout or math.inf, on_loss)
            failures = Failures(request.max_failures, plan.to_make)
            is_shown = has_bars() if progress is None else progress
            bar = RunBar(plan.to_make) if is_shown else None

            def hear(message: Begun | Made | Committed) -> None:
                made = losses.news(message)
                if made is None:
                    return
                log.count()
                if lock.is_alone and is_time_to_pack(made.index, config.block_size):
                    pack(path)
                on_episode(made)
                if bar is not None:
                    bar.episode(made)
                failures.count(made)

            jobs = [BlockJob(block=block, retries=retry_quarantined) for block in plan.blocks]
            with (
                bar or contextlib.nullcontext(),
                contextlib.closing(BlockMaker(config, target if kind.has_nodes else path)) as task,
                _check_of_nodes(request, target, kind, is_alone=lock.is_alone) as check,
            ):
                engine.run(task, jobs, hear, losses.recover, losses.silence, check_node=check)
        if lock.try_alone():
            ZarrWriter(path).remove_leftovers()
            pack(path)
        return _summary(request, plan, time.monotonic() - start)


def origin_attributes(config: FactoryConfig, robot: RobotModel) -> dict[str, Any]:
    """Return root attributes of a new store: the robot's facts and this platform's fingerprint."""
    return {"robot": robot.facts(), FINGERPRINT: fingerprint(config).parts()}


def _check_of_nodes(
    request: Request, target: Path, kind: ExecutorKind, *, is_alone: bool
) -> contextlib.AbstractContextManager[Callable[[], None]]:
    if not kind.has_nodes:
        return contextlib.nullcontext(go_on)
    accept = request.accept_other_platform
    return node_check(target, request.config, accept=accept, is_alone=is_alone)


def _lock(request: Request) -> StoreLock | ShardLock:
    shard = request.shard
    if shard.count == 1:
        return StoreLock(request.out)
    return ShardLock(request.out, shard.index % shard.count, shard.count)


def _plan(request: Request) -> RunPlan:
    length, size = len(Dataset(request.out)), request.config.block_size
    if length < request.n:
        raise StoreBusyError(
            f"{request.out} has room for {length} episodes, and cannot grow to {request.n} while"
            " runs with --shard are at work on it; wait for them"
        )
    missing = missing_rows(request.out, quarantined=request.retry_quarantined)
    part = shard_rows(request)
    wanted = np.intersect1d(missing, part, assume_unique=True)
    blocks = np.unique(wanted // size)
    return RunPlan(
        path=request.out,
        config=request.config,
        episodes=length,
        to_make=int(np.isin(missing // size, blocks).sum()),
        already_there=len(part) - len(wanted),
        blocks=tuple(blocks.tolist()),
        workers=request.workers,
        shard=request.shard,
    )


def _summary(request: Request, plan: RunPlan, seconds: float) -> Summary:
    rows, columns = shard_rows(request), Columns.open(request.out)
    bad = rows[columns.read("status")["status"][rows] == QUARANTINED]
    reasons = {int(i): str(columns.read_rows("error", i, i + 1)[0]) for i in bad}
    return Summary(
        asked=len(rows),
        made=plan.to_make,
        already_there=plan.already_there,
        seconds=round(seconds, 3),
        episodes_per_second=round(plan.to_make / seconds, 3) if plan.blocks else None,
        quarantined=reasons,
        failed=len(bad) > request.max_failures * len(rows),
        store=summarise(Dataset(request.out)),
    )
