"""One export: checked first, built in a scratch folder, then moved to its path as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.episode import Episode
from grasp_factory.core.executors import Executor, SendMessage, SharingExecutor, Worker
from grasp_factory.core.executors.process_start import check_main_guard
from grasp_factory.core.output_folder import check_free, publish
from grasp_factory.core.place import place_at
from grasp_factory.core.place_tree import file_facts_below, fsync_tree
from grasp_factory.core.scratch_folder import scratch_folder
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import StoreError, UsageError, WorkerError, shown
from grasp_factory.writers.exporters.base import ExportContents, Exporter, ExportJob, ExportPart
from grasp_factory.writers.exporters.export_record import line_of_each, write_record
from grasp_factory.writers.exporters.selection import EpisodeSource, Selection, select

_LONGEST_PREFIX = 40
"""Characters of the name that the hidden scratch folder repeats: file systems limit its length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """What an export wrote."""

    path: Path
    format: str
    episodes: int
    bytes: int
    contents: ExportContents
    excluded: Mapping[str, int]
    """Number of chosen episodes that the format cannot hold, by reason."""
    quarantined: int
    """Number of rows of the stores that have no episode, because it could not be made."""


def run_export(
    exporter: Exporter,
    chosen: Sequence[tuple[EpisodeSource, Sequence[int]]],
    out: Path,
    settings: Mapping[str, Any],
    *,
    workers: int = 1,
    ready: Sequence[Worker] = (),
    on_start: Callable[[int], None] = lambda total: None,
    on_episode: Callable[[], None] = lambda: None,
) -> Exported:
    """Export rows of datasets to the folder ``out``; after an error it does not exist.

    Args:
        exporter: the format.
        chosen: the datasets, each with its rows that hold an episode, each row once.
        out: the folder to create. It must not exist.
        settings: the format's settings as plain data.
        workers: number of processes, this one among them. The files do not depend on it.
        ready: workers that ``early_workers`` started.
        on_start: called with the number of episodes.
        on_episode: called after each episode.

    Raises:
        UsageError: for a place that is taken or cannot be written to, a missing library, rows
            without an episode, datasets that differ in cameras or rates, a number of workers
            below 1, or episodes that the format cannot hold.
        ConfigError: for a setting that is not valid.
        StoreError: if a dataset is damaged, or the disk fails or is full.
        WorkerError: if a worker process cannot start, or dies.
    """
    check_main_guard()
    if not is_integer(workers) or workers < 1:
        raise UsageError(f"workers: got {shown(workers)}, valid: an integer from 1")
    exporter.check_libraries()
    record = exporter.settings(settings)
    check_free(out, "an export")
    episodes, excluded = _held(exporter, select(chosen), record)
    prepared = exporter.prepare(episodes, record)
    on_start(len(episodes))
    try:
        with scratch_folder(out.parent, f"{out.name[:_LONGEST_PREFIX]}.exporting") as scratch:
            built, aside, lines = (scratch / name for name in ("out", "aside", "lines"))
            for folder in (built, aside, lines):
                folder.mkdir()
            job = ExportJob(
                episodes=episodes,
                folder=built,
                aside=aside,
                settings=record,
                prepared=prepared,
            )
            executor = SharingExecutor(workers, ready)
            _write(exporter, job, lines, executor, on_episode)
            write_record(job, exporter, excluded, sorted(lines.iterdir()))
            size = sum(facts.st_size for _, facts in file_facts_below(place_at(built)))
            fsync_tree(place_at(built))
            publish(built, out, "an export")
    except OSError as error:
        raise StoreError(f"{out} cannot be written: {error.strerror or error}") from None
    return Exported(
        path=out,
        format=exporter.name,
        episodes=len(episodes),
        bytes=size,
        contents=exporter.contents,
        excluded={reason: len(rows) for reason, rows in excluded.items()},
        quarantined=episodes.quarantined,
    )


def _held(
    exporter: Exporter, episodes: Selection, settings: Any
) -> tuple[Selection, dict[str, Selection]]:
    """Return the episodes that the format can hold, and the others by reason."""
    keep = np.ones(len(episodes), np.bool_)
    excluded: dict[str, Selection] = {}
    for reason, mask in exporter.excludes(episodes, settings).items():
        if (mask & keep).any():
            excluded[reason] = episodes.only(mask & keep)
        keep &= ~mask
    if not keep.any():
        why = "; ".join(f"{len(rows)}: {reason}" for reason, rows in excluded.items())
        raise UsageError(f"{exporter.name} can hold none of {len(episodes)} episodes ({why})")
    return episodes.only(keep), excluded


def _write(
    exporter: Exporter,
    job: ExportJob,
    lines: Path,
    executor: Executor,
    on_episode: Callable[[], None],
) -> None:
    """Write all parts, then what describes all of them."""
    parts = list(enumerate(exporter.split(job.episodes, job.settings)))
    task = partial(_write_part, exporter, job, lines)
    results = executor.run(task, parts, lambda _: on_episode(), _give_up)
    exporter.finish(job, results)


def _write_part(
    exporter: Exporter,
    job: ExportJob,
    lines: Path,
    part: tuple[int, Sequence[int]],
    report: SendMessage,
) -> Any:
    number, places = part
    line = line_of_each(job.episodes, places)
    with (lines / f"{number:08d}").open("w", encoding="utf-8") as file:

        def episodes() -> Iterator[tuple[int, Episode]]:
            for place, episode in job.episodes.each(places, exporter.series):
                yield place, episode
                file.write(line(place, episode))
                report(place)

        return exporter.write_part(
            job, ExportPart(number=number, places=tuple(places), episodes=episodes())
        )


def _give_up(part: Any, why: str) -> Any:
    raise WorkerError(
        f"a worker was lost ({why}), so nothing was written; run the same command again, or with"
        " fewer workers if memory was short"
    )
