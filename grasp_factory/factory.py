"""The factory: which blocks are missing, make them on an executor, say what came of it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from grasp_factory import carried
from grasp_factory.config import FactoryConfig
from grasp_factory.dataset import Dataset
from grasp_factory.episode import Episode
from grasp_factory.errors import RecipeError, lookup
from grasp_factory.executors import Report, make_executor
from grasp_factory.objects import OBJECT_SETS, find_set
from grasp_factory.policies import POLICIES
from grasp_factory.records import check
from grasp_factory.request import Request
from grasp_factory.robots import ROBOTS, RobotModel
from grasp_factory.rollout import run_episode
from grasp_factory.runlog import RunLog
from grasp_factory.sampling import sample_spec
from grasp_factory.summary import StoreSummary, summarise
from grasp_factory.world import World
from grasp_factory.world.connection import check_renderer
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.lock import StoreLock
from grasp_factory.writers.packing import is_time_to_pack, pack
from grasp_factory.writers.store import check_place, pending_blocks, prepare_store
from grasp_factory.writers.zarr import ZarrWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """What a run is about to do."""

    path: Path
    config: FactoryConfig
    episodes: int
    """Rows of the store."""
    to_make: int
    """Episodes in the blocks that are not there yet."""
    blocks: tuple[int, ...]
    workers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """One episode, in few words: what travels from a worker instead of its images."""

    index: int
    policy: str
    outcome: str
    """``quarantined`` for a recipe that could not be built."""
    reason: str = ""
    """Why it is quarantined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a run did, and what the store holds now."""

    asked: int
    made: int
    already_there: int
    """Of those asked for."""
    seconds: float
    episodes_per_second: float | None
    """None when nothing was to be made."""
    store: StoreSummary


def generate(
    config: FactoryConfig,
    n: int,
    out: Path | str,
    workers: int = 2,
    *,
    on_start: Callable[[Plan], None] = lambda plan: None,
    on_episode: Callable[[Made], None] = lambda made: None,
) -> Summary:
    """Make sure that the store at ``out`` holds episodes 0 to ``n`` - 1 of ``config``.

    What is there stays as it is; a run that was stopped goes on where it was. With more than one
    worker, call it under ``if __name__ == "__main__":``, as everything that spawns processes.

    Args:
        config: what decides the episodes' content.
        n: how many episodes the store shall have.
        out: the store, new or of the same config.
        workers: processes; 1 works in this one.
        on_start: called once with the plan, after every check and before the first episode.
        on_episode: called for each episode as it is made; its block is committed later.

    Raises:
        UsageError: for what cannot be done; nothing has been written.
        StoreError: if the store cannot be written, or another process is writing to it.
        WorkerError: if a worker died; the blocks that were committed stay.
    """
    request = Request(config=config, n=n, workers=workers, out=Path(out))
    path, start = request.out, time.monotonic()
    target = check_place(path, config)
    carried.unpack(path, config)
    robot = check_names(config)
    check_renderer(config.renderer)
    with StoreLock(path), RunLog(target, request) as log:
        facts = {"robot": robot.facts()}
        objects = carried.packed(config)
        prepare_store(path, config, len(robot.arm_joints), request.n, facts, objects=objects)
        plan = _plan(request)
        on_start(plan)
        if plan.blocks:
            log.begin()

            def count(made: Made) -> None:
                log.count()
                if is_time_to_pack(made.index, config.block_size):
                    pack(path)
                on_episode(made)

            with contextlib.closing(BlockMaker(config, path)) as task:
                make_executor(request.workers).run(task, plan.blocks, count)
        pack(path)
        seconds = time.monotonic() - start
        return Summary(
            asked=request.n,
            made=plan.to_make,
            already_there=_there(plan, request.n),
            seconds=round(seconds, 3),
            episodes_per_second=round(plan.to_make / seconds, 3) if plan.blocks else None,
            store=summarise(Dataset.open(path)),
        )


def check_names(config: FactoryConfig) -> RobotModel:
    """Check every name in a config against its table, with its settings; return the robot.

    Raises:
        UnknownNameError: naming the kind, the nearest and all valid names.
        ConfigError: naming a policy's setting, or what the robot cannot do.
    """
    for name in {**config.policies, **config.policy_parameters}:
        lookup(POLICIES, "policy", name).settings(config.policy_parameters.get(name, {}))
    for object_set in config.object_sets:
        find_set(object_set, config.object_folders.get(object_set, ""))
    for folder in config.object_folders:
        ok = folder not in OBJECT_SETS and folder in config.object_sets
        valid = "a set of object_sets that is none of those that are shipped"
        check(ok, "object_folders", folder, valid)
    robot = lookup(ROBOTS, "robot", config.robot)
    (low, high), force = robot.gripper.force_range, config.motion.grip_force
    valid = f"{low:g} to {high:g} N, which is what the gripper of {robot.name} can do"
    check(low <= force <= high, "motion.grip_force", force, valid)
    return robot


class BlockMaker:
    """Makes whole blocks and writes them; only ``Made`` records leave it.

    It travels to a worker as config and path. There, or here, it opens its world and its writer at
    its first block and keeps them: an episode does not notice those before it.
    """

    def __init__(self, config: FactoryConfig, path: Path) -> None:
        self._config, self._path = config, path

    def __reduce__(self) -> tuple[Any, ...]:
        return BlockMaker, (self._config, self._path)

    def __call__(self, block: int, report: Report) -> list[Made]:
        """Make a block, and report each episode as it is made."""
        rows: list[Episode | Quarantined] = []
        done: list[Made] = []
        for index in block_range(block, self._config.block_size, self._writer.length):
            row = _make_row(self._world, self._config, index)
            rows.append(row)
            done.append(_in_few_words(row))
            report(done[-1])
        self._writer.write_block(block, rows)
        return done

    def close(self) -> None:
        """Close the world, if one was opened in this process."""
        if "_world" in self.__dict__:
            self._world.close()

    @cached_property
    def _world(self) -> World:
        return World(self._config.renderer)

    @cached_property
    def _writer(self) -> ZarrWriter:
        return ZarrWriter(self._path)


def block_range(block: int, block_size: int, length: int) -> range:
    """Return the episodes of a block in a store of ``length`` rows."""
    return range(block * block_size, min((block + 1) * block_size, length))


def _make_row(world: World, config: FactoryConfig, index: int) -> Episode | Quarantined:
    spec = sample_spec(config, index)
    try:
        return run_episode(world, spec)
    except RecipeError as error:
        return Quarantined(spec, str(error))


def _in_few_words(row: Episode | Quarantined) -> Made:
    more: dict[str, Any] = {"index": row.spec.index, "policy": row.spec.policy}
    if isinstance(row, Quarantined):
        return Made(outcome="quarantined", reason=row.reason, **more)
    return Made(outcome=row.outcome.name.lower(), **more)


def _plan(request: Request) -> Plan:
    blocks = tuple(pending_blocks(request.out, request.n))
    length = len(Dataset.open(request.out))
    size = request.config.block_size
    return Plan(
        path=request.out,
        config=request.config,
        episodes=length,
        to_make=sum(len(block_range(block, size, length)) for block in blocks),
        blocks=blocks,
        workers=request.workers,
    )


def _there(plan: Plan, n: int) -> int:
    """Return how many of the first ``n`` episodes no block of the plan holds."""
    size = plan.config.block_size
    return n - sum(len(block_range(block, size, min(n, plan.episodes))) for block in plan.blocks)
