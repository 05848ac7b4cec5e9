"""Making blocks of episodes: what a worker does."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.os_errors import HOW_TO_CONTINUE, MACHINE_ERRNOS, NO_THREAD
from grasp_factory.core.simulated_row import with_room_for_real
from grasp_factory.dataset.row_reader import RowReader, StoredRow
from grasp_factory.errors import LimitError, RecipeError, StoreError
from grasp_factory.factory.block_job import (
    LONGEST_REASON,
    Begun,
    BlockJob,
    Committed,
    block_range,
    summary_of,
)
from grasp_factory.factory.plugins import activate
from grasp_factory.policies.model_registry import find_model
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.writer import COMMITTED, ZarrWriter


class BlockMaker:
    """Makes whole blocks and writes them; it reports ``Begun``, ``Made`` and ``Committed``.

    Only config and path are sent to a worker. Each process opens its world and its writer at its
    first block and keeps them: an episode does not depend on the episodes before it.
    """

    def __init__(self, config: FactoryConfig, path: Path) -> None:
        self._config, self._path = config, path

    def __reduce__(self) -> tuple[Any, ...]:
        return BlockMaker, (self._config, self._path)

    def __call__(self, job: BlockJob, report: SendMessage) -> None:
        """Make the missing rows of a block, and keep the existing ones.

        Raises:
            StoreError: if the block cannot be written, is damaged, or the disk fails otherwise.
        """
        activate(self._config)
        kept, here = self._present_rows(job), self.fingerprint
        rows = {i: row.content for i, row in kept.items()}
        for index in block_range(job.block, self._config.block_size, self._writer.length):
            if index in rows:
                continue
            if index not in job.lost:
                report(Begun(index=index))
            spec = sample_spec(self._config, index)
            rows[index] = self.make_row(spec, job.lost.get(index, ""))
            report(summary_of(rows[index], index))
        with _naming_disk_errors(f"{self._path}: block {job.block} cannot be written"):
            texts = [kept[i].fingerprint if i in kept else here for i in sorted(rows)]
            self._writer.write_block(job.block, [rows[i] for i in sorted(rows)], texts)
        report(Committed(block=job.block))

    def close(self) -> None:
        """Close the world, if one was opened in this process."""
        if "_world" in self.__dict__:
            self.__dict__.pop("_world").close()

    @cached_property
    def fingerprint(self) -> str:
        """The fingerprint, as text, of the platform that this process runs on.

        It is measured before the world is opened: OpenGL allows one world at a time.
        """
        return fingerprint(self._config).text

    def _present_rows(self, job: BlockJob) -> dict[int, StoredRow]:
        """Return the rows to keep: a run for fewer episodes may have made a part of the block."""
        present = self._writer.present(job.block)
        keep = [i for i, status in present.items() if status == COMMITTED or not job.retries]
        reader = RowReader(self._path) if keep else None
        return {i: row for i in keep if reader for row in reader.read(i, i + 1)}

    def make_row(self, spec: EpisodeSpec, lost: str) -> Episode | Quarantined:
        """Simulate a recipe, or quarantine it if it yields no episode.

        Args:
            spec: the recipe.
            lost: why it is quarantined without being tried; empty to try it.

        Raises:
            StoreError: if the machine is at fault.
            UsageError: if a trained model cannot be loaded here; no episode is at fault then.
        """
        for sha256 in self._config.models.values():
            find_model(sha256)
        if lost:
            return Quarantined(spec, lost)
        try:
            return with_room_for_real(run_episode(self._world, spec), self._config)
        except RecipeError as error:
            _raise_if_machine_failed(error.__context__, spec.index)
            return Quarantined(spec, str(error))
        except (MemoryError, LimitError):
            raise
        except Exception as error:
            _raise_if_machine_failed(error, spec.index)
            self.close()  # the next episode must not depend on this world
            return Quarantined(spec, _reason(error))

    @cached_property
    def _world(self) -> World:
        return World(self._config.renderer)

    @cached_property
    def _writer(self) -> ZarrWriter:
        return ZarrWriter(self._path)


def _reason(error: Exception) -> str:
    """Return the type and the text of an unforeseen error in one line.

    The reason is part of the dataset, so it must not name a source file or a line number.
    """
    text = " ".join(str(error).split())[:LONGEST_REASON]
    return f"{type(error).__name__}: {text}"


def _raise_if_machine_failed(error: BaseException | None, index: int) -> None:
    """Raise if the machine is at fault: an episode must not be quarantined for that."""
    # All files that an episode needs are in the package or the store: a missing one was removed.
    if isinstance(error, OSError) and error.errno in MACHINE_ERRNOS | {errno.ENOENT}:
        raise StoreError(
            f"episode {index} cannot be made: {error.strerror}; {HOW_TO_CONTINUE}"
        ) from None
    if isinstance(error, RuntimeError) and str(error) == NO_THREAD:
        raise StoreError(f"episode {index} cannot be made: {error}; {HOW_TO_CONTINUE}") from None


@contextlib.contextmanager
def _naming_disk_errors(what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise StoreError(f"{what}: {error.strerror or error}; {HOW_TO_CONTINUE}") from None
