"""The import of a session into a new store, and of one of its episodes again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grasp_factory.capture.importing.cuts import Cut
from grasp_factory.capture.importing.device_tracks import tracks_of
from grasp_factory.capture.importing.grasp_columns import closings_of
from grasp_factory.capture.importing.import_settings import ImportSettings
from grasp_factory.capture.importing.session_contents import read_contents
from grasp_factory.capture.importing.session_import import SessionImport, open_import
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.core.serialization import from_plain
from grasp_factory.errors import CaptureError, StoreMismatchError, UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.segment_packing import pack
from grasp_factory.writers.zarr.store import check_place, prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedRow:
    """An episode of a session as a row of the store."""

    index: int
    start_s: float
    """Seconds from the session's start."""
    duration_s: float
    outcome: str
    """``quarantined`` for one that is not used."""
    reason: str = ""
    """Why it is quarantined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedSession:
    """What an import made."""

    path: str
    session: str
    sha256: str
    rows: tuple[ImportedRow, ...]

    @property
    def committed(self) -> int:
        """How many rows hold an episode."""
        return sum(not row.reason for row in self.rows)


def import_session(
    session: Path,
    out: Path,
    settings: ImportSettings,
    *,
    base: FactoryConfig | None = None,
    listed: Sequence[Cut] = (),
    on_start: Callable[[int], None] = lambda episodes: None,
    on_row: Callable[[ImportedRow], None] = lambda row: None,
) -> ImportedSession:
    """Import the episodes of a session into a new store.

    Args:
        session: its folder.
        out: where nothing is yet.
        settings: of the import.
        base: the config of the store; None to follow the session.
        listed: the list of cuts, for that method.
        on_start: called with the number of episodes.
        on_row: called for each episode when it is made.

    Raises:
        CaptureError: if it is no session, or damaged.
        UsageError: if something is at ``out``, or the session does not fit the config.
        StoreError: if the store cannot be written.
    """
    check_free(out)
    found = open_import(session, settings, base=base, listed=listed)
    specs, config = found.specs(), found.config
    check_place(out, config)
    robot = ROBOTS[config.robot]
    on_start(len(specs))
    told: list[ImportedRow] = []
    with StoreLock(out):
        attributes = {"robot": robot.facts()}
        prepare_store(out, config, len(robot.arm_joints), len(specs), attributes)
        writer = ZarrWriter(out)
        block: list[Episode | Quarantined] = []

        def take(index: int, row: Episode | Quarantined) -> None:
            block.append(row)
            if len(block) == writer.block_size or index == len(specs) - 1:
                writer.write_block(index // writer.block_size, block)
                block.clear()
            told.append(_told(found, index, row))
            on_row(told[-1])

        found.make(specs, take)
        pack(out)
    return ImportedSession(
        path=str(out), session=str(session), sha256=found.contents.sha256, rows=tuple(told)
    )


def import_again(session: Path, spec: EpisodeSpec, config: FactoryConfig) -> Episode | Quarantined:
    """Return the episode of a real row's recipe, imported again.

    Args:
        session: the session's folder.
        spec: the recipe.
        config: of the store.

    Raises:
        CaptureError: if it is another session, or its settings or calibration were changed.
    """
    source = spec.recording
    if source is None:
        raise UsageError(f"episode {spec.index} is simulated: it has no session")
    contents = read_contents(session)
    for what, got, wanted in (
        ("session.mcap", contents.sha256, source.sha256),
        ("session.yaml and calibration", contents.calibration_sha256, source.calibration_sha256),
    ):
        if got != wanted:
            raise CaptureError(
                f"{session} is not what episode {spec.index} was imported from: SHA-256 of {what}"
                f" is {got[:12]}..., the recipe has {wanted[:12]}...; the session was"
                f" {source.session}"
            )
    settings = from_plain(ImportSettings, source.settings, "spec.recording.settings")
    contents = replace(contents, name=source.session, path=source.path)
    tracks = tracks_of(contents, settings)
    cut = Cut(start_ns=source.start_ns, end_ns=source.end_ns, outcome=source.label)
    found = SessionImport(
        session=session,
        contents=contents,
        tracks=tracks,
        settings=settings,
        cuts=(cut,),
        closings=closings_of(contents, tracks, settings),
        config=config,
    )
    made: list[Episode | Quarantined] = []
    found.make([spec], lambda _, row: made.append(row))
    return made[0]


def check_free(out: Path) -> None:
    """Check that no store is at a path; ``check_place`` refuses anything else there.

    Raises:
        StoreMismatchError: if there is one.
    """
    if (locate(out) / "zarr.json").exists():
        raise StoreMismatchError(f"{out} exists, only new stores are made; choose another --out")


def _told(found: SessionImport, index: int, row: Episode | Quarantined) -> ImportedRow:
    cut = found.cuts[index]
    is_bad = isinstance(row, Quarantined)
    return ImportedRow(
        index=index,
        start_s=(cut.start_ns - found.contents.span[0]) / 1e9,
        duration_s=(cut.end_ns - cut.start_ns) / 1e9,
        outcome="quarantined" if isinstance(row, Quarantined) else row.outcome.name.lower(),
        reason=row.reason if is_bad and isinstance(row, Quarantined) else "",
    )
