"""Making blocks of episodes: what a worker does, and what it tells of it."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from grasp_factory.config import FactoryConfig
from grasp_factory.episode import Episode
from grasp_factory.errors import RecipeError, StoreError
from grasp_factory.executors import Report
from grasp_factory.rollout import run_episode
from grasp_factory.sampling import sample_spec
from grasp_factory.trouble import GO_ON, MACHINE_TROUBLE
from grasp_factory.world import World
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr import ZarrWriter

LONGEST_REASON = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockJob:
    """A block to make."""

    block: int
    lost: Mapping[int, str] = field(default_factory=dict)
    """Episodes of it that are not tried any more, and why; they are quarantined."""

    def __str__(self) -> str:
        return f"block {self.block}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """An episode is about to be made."""

    index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """One episode, in few words: what travels from a worker instead of its images."""

    index: int
    policy: str
    outcome: str
    """``quarantined`` for a recipe that gave no episode."""
    reason: str = ""
    """Why it is quarantined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Committed:
    """A block is in the store, for good."""

    block: int


class BlockMaker:
    """Makes whole blocks and writes them; it reports ``Begun``, ``Made`` and ``Committed``.

    It travels to a worker as config and path. There, or here, it opens its world and its writer at
    its first block and keeps them: an episode does not notice those before it.
    """

    def __init__(self, config: FactoryConfig, path: Path) -> None:
        self._config, self._path = config, path

    def __reduce__(self) -> tuple[Any, ...]:
        return BlockMaker, (self._config, self._path)

    def __call__(self, job: BlockJob, report: Report) -> None:
        """Make a block.

        Raises:
            StoreError: if it cannot be written, or the disk fails otherwise.
        """
        rows: list[Episode | Quarantined] = []
        for index in block_range(job.block, self._config.block_size, self._writer.length):
            report(Begun(index=index))
            rows.append(self._make_row(index, job.lost.get(index, "")))
            report(_in_few_words(rows[-1]))
        with _naming_disk_trouble(f"{self._path}: block {job.block} cannot be written"):
            self._writer.write_block(job.block, rows)
        report(Committed(block=job.block))

    def close(self) -> None:
        """Close the world, if one was opened in this process."""
        if "_world" in self.__dict__:
            self.__dict__.pop("_world").close()

    def _make_row(self, index: int, lost: str) -> Episode | Quarantined:
        spec = sample_spec(self._config, index)
        if lost:
            return Quarantined(spec, lost)
        try:
            return run_episode(self._world, spec)
        except RecipeError as error:
            _blame_machine(error.__context__, index)
            return Quarantined(spec, str(error))
        except MemoryError:
            raise
        except Exception as error:
            _blame_machine(error, index)
            self.close()  # whatever it did to the world, the next episode shall not notice
            return Quarantined(spec, _reason(error))

    @cached_property
    def _world(self) -> World:
        return World(self._config.renderer)

    @cached_property
    def _writer(self) -> ZarrWriter:
        return ZarrWriter(self._path)


def block_range(block: int, block_size: int, length: int) -> range:
    """Return the episodes of a block in a store of ``length`` rows."""
    return range(block * block_size, min((block + 1) * block_size, length))


def _in_few_words(row: Episode | Quarantined) -> Made:
    more: dict[str, Any] = {"index": row.spec.index, "policy": row.spec.policy}
    if isinstance(row, Quarantined):
        return Made(outcome="quarantined", reason=row.reason, **more)
    return Made(outcome=row.outcome.name.lower(), **more)


def _reason(error: Exception) -> str:
    """Return kind, text and place of an unforeseen error in one line, without any path."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    text = " ".join(str(error).split())[:LONGEST_REASON]
    return f"{type(error).__name__}: {text} ({Path(place.filename).name}:{place.lineno})"


def _blame_machine(error: BaseException | None, index: int) -> None:
    """Raise if the machine is at fault: an episode must not be quarantined for that."""
    if isinstance(error, OSError) and error.errno in MACHINE_TROUBLE:
        raise StoreError(f"episode {index} cannot be made: {error.strerror}; {GO_ON}") from None


@contextlib.contextmanager
def _naming_disk_trouble(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(f"{what}: {error.strerror or error}; {GO_ON}") from None
