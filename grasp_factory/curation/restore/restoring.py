"""Restoring a store: blocks are read from the export, written and packed at a free path."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.output_file import is_in_store
from grasp_factory.core.serialization import is_integer, to_plain
from grasp_factory.curation.merge.provenance import SeedSource, makers_of, once
from grasp_factory.curation.merge.staged_store import StagedStore
from grasp_factory.curation.restore.added_data import check_changes
from grasp_factory.curation.restore.episode_values import check_text, episode_of
from grasp_factory.curation.restore.exported import DAMAGE, ExportedEpisodes, open_export
from grasp_factory.dataset.annotations.carrying import write_log
from grasp_factory.errors import RefusedFileError, StoreError, UsageError, shown
from grasp_factory.writers.exporters.export_record import RECORD
from grasp_factory.writers.zarr.header import SOURCES
from grasp_factory.writers.zarr.made_of_export import imported
from grasp_factory.writers.zarr.segment_packing import pack
from grasp_factory.writers.zarr.store import create_store
from grasp_factory.writers.zarr.writer import ZarrWriter

MOST_NAMED = 10
"""Episodes that are not the same and are named."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Restored:
    """What was restored."""

    path: str
    format: str
    episodes: int
    same: int
    """Episodes whose every value is that of the store that was exported, by their checksums."""
    others: tuple[int, ...]
    """Numbers of the first episodes that are not the same, from 0, at most ``MOST_NAMED``."""
    not_held: tuple[str, ...]
    """Arrays that the export does not hold: they have the fill value."""
    labels: tuple[str, ...]
    """Names of added labels."""
    annotations: int
    """Episodes with annotations."""


def restore(
    export: Path | str,
    out: Path | str,
    *,
    on_start: Callable[[int], None] = lambda episodes: None,
    on_episode: Callable[[], None] = lambda: None,
) -> Restored:
    """Make a store of an export.

    Args:
        export: the folder that an export wrote.
        out: a path where nothing exists yet, or an empty directory.
        on_start: called with the number of episodes.
        on_episode: called after each episode.

    Raises:
        UsageError: if ``export`` is no export that can be read back, or ``out`` is taken, in a
            store or in the export.
        StoreError: if the export is damaged, or the disk fails. Nothing is left then.
    """
    place, source = StagedStore(out), Path(export)
    _check_apart(Path(out), source)
    told: list[int] = []

    def pass_on(message: int) -> None:
        """Take the number of episodes, and after it each episode."""
        if told:
            on_episode()
        else:
            told.append(message)
            on_start(message)

    with place.building() as aside:
        found: Restored = in_import_process(_build, (source, aside), source, pass_on)
    return replace(found, path=str(out))


def _check_apart(out: Path, export: Path) -> None:
    real = Path(os.path.realpath(out))
    if is_in_store(real):
        raise UsageError(f"{out} is inside a store, which holds data only: choose another OUT")
    if real.is_relative_to(os.path.realpath(export)):
        raise UsageError(f"{out} lies in the export {export}: choose another OUT")


def _build(job: tuple[Path, Path], report: SendMessage) -> Restored:
    """Build the store of an export in an empty folder.

    It reports the number of episodes first, and then the number of each episode.
    """
    path, aside = job
    source = open_export(path)
    report(len(source.lines))
    with source.reading() as file:
        reader = ExportedEpisodeReader(source=source, file=file)
        not_held = reader.not_held()
        create_store(
            aside,
            source.folder.config,
            _attributes(source, reader.rows_by_seed(), not_held),
            joints=source.folder.joints,
            n=len(source.lines),
            carried=source.embedded(),
            fields=list(source.folder.fields.values()),
        )
        others = _write(reader, aside, report)
    for label in source.labels:
        label.write(aside)
    annotated = _annotate(source, aside)
    pack(aside)
    return Restored(
        path=str(aside),
        format=source.exporter.name,
        episodes=len(source.lines),
        same=len(source.lines) - len(others),
        others=tuple(others[:MOST_NAMED]),
        not_held=not_held,
        labels=tuple(label.name for label in source.labels),
        annotations=annotated,
    )


def _annotate(source: ExportedEpisodes, store: Path) -> int:
    """Write the annotations to a store; return how many episodes have any."""
    try:
        check_changes(store, source.changes)
    except ValueError as error:
        raise StoreError(f"{source.path / RECORD} is damaged: {error}") from None
    if source.changes:
        write_log(store, source.changes)
    return len({change.row for change in source.changes})


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedEpisodeReader:
    """Reads episodes of an export."""

    source: ExportedEpisodes
    file: BinaryIO
    """The lines of the episodes."""

    def not_held(self) -> tuple[str, ...]:
        """Return the store's images and time series that the export does not hold."""
        held = self._held(0)
        there = self.source.folder.fields.values()
        return tuple(
            field.path
            for field in there
            if (field.is_image or field.length_column) and field.path not in held
        )

    def rows_by_seed(self) -> dict[int, int]:
        """Return the number of episodes of each seed, in the order of the episodes."""
        places = range(len(self.source.lines))
        return dict(Counter(self._column(place, "seed") for place in places))

    def read(self, place: int) -> tuple[Episode, str, str]:
        """Return an episode, the checksum that it had in its store, and its fingerprint.

        Raises:
            StoreError: if it is damaged.
        """
        line = self.source.line(self.file, place)
        try:
            episode = episode_of(line, self._held(place), self.source.folder)
            fingerprint = str(line["fingerprint"])
            for text in (fingerprint, episode.spec.to_json()):
                check_text(text)
            return episode, str(line["checksum"]), fingerprint
        except RefusedFileError:
            raise
        except (*DAMAGE, OSError) as error:
            raise self._damaged(place, error) from None

    def _held(self, place: int) -> Mapping[str, NDArray[Any]]:
        read_back = self.source.exporter.read_back
        assert read_back
        try:
            return read_back(self.source.folder, place)
        except RefusedFileError:
            raise
        except (*DAMAGE, OSError) as error:
            raise self._damaged(place, error) from None

    def _column(self, place: int, name: str) -> int:
        columns = self.source.line(self.file, place).get("columns")
        value: Any = columns.get(name) if isinstance(columns, Mapping) else None
        if not is_integer(value):
            raise self._damaged(place, f"{name}: got {shown(value)}")
        return int(value)

    def _damaged(self, place: int, why: object) -> StoreError:
        what = str(why).splitlines() or [type(why).__name__]
        return StoreError(f"{self.source.path}: episode {place} is damaged: {what[0]}")


def _write(reader: ExportedEpisodeReader, out: Path, report: SendMessage) -> list[int]:
    """Write the episodes; return the numbers of those that are not as in their store."""
    writer, others = ZarrWriter(out), list[int]()
    for start in range(0, writer.length, writer.block_size):
        rows, texts = [], []
        for place in range(start, min(start + writer.block_size, writer.length)):
            episode, checksum, fingerprint = reader.read(place)
            if episode.checksum() != checksum:
                others.append(place)
            rows.append(episode)
            texts.append(fingerprint)
            report(place)
        writer.write_block(start // writer.block_size, rows, texts)
    return others


def _attributes(
    source: ExportedEpisodes, rows: Mapping[int, int], not_held: tuple[str, ...]
) -> dict[str, Any]:
    """Return the root attributes: the first store's, where the rows come from, what is missing."""
    makers = [
        makers_of(source.path, attributes, int(attributes["config"]["seed"]))
        for attributes in source.attributes
    ]
    config = source.folder.config
    seeds = [
        SeedSource(
            seed=seed,
            rows=count,
            config_sha256=replace(config, seed=seed).sha256(),
            made_with=once(maker for known in makers for maker in known.get(seed, ())),
        )
        for seed, count in rows.items()
    ]
    origin = {SOURCES: to_plain(seeds), **imported(source.exporter.name, not_held)}
    return {**source.attributes[0], **origin}
