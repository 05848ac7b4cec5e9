"""Repairing a store: what verify finds is rebuilt, and the store is verified again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.object_storage.address import on_disk
from grasp_factory.core.os_errors import adding_how_to_continue
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.serialization import from_plain
from grasp_factory.curation.relabel import relabel
from grasp_factory.curation.repair.rebuild import RebuiltEpisode
from grasp_factory.curation.repair.repair_session import RepairSession
from grasp_factory.curation.repair.template import remove_template, template_place
from grasp_factory.curation.verify.auxiliary_data import leftovers, thresholds_of
from grasp_factory.curation.verify.documents import FILE
from grasp_factory.curation.verify.problems import Problem, VerifyReport
from grasp_factory.curation.verify.verification import verify
from grasp_factory.errors import GraspFactoryError
from grasp_factory.writers.zarr.label_columns import LABEL_COLUMNS, LABELS
from grasp_factory.writers.zarr.lock import StoreLock
from grasp_factory.writers.zarr.segment_packing import pack

DAMAGED = ".damaged"
"""Ends the name of a damaged label's folder, which is kept until the label is rebuilt."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RepairReport:
    """What a repair found, did, and left."""

    before: VerifyReport
    after: VerifyReport
    mended: tuple[str, ...]
    """What was repaired or removed, one line each."""
    failed: tuple[str, ...]
    """What could not be repaired, and why, one line each."""
    remade: tuple[RebuiltEpisode, ...]
    """Episodes that were simulated again."""

    @property
    def is_whole(self) -> bool:
        """Whether the store has no problem any more."""
        return self.after.is_whole


def repair(
    path: Path | str,
    workers: int = 1,
    *,
    accept_other_platform: bool = False,
    on_start: Callable[[int], None] = lambda rows: None,
    on_episode: Callable[[int], None] = lambda row: None,
) -> RepairReport:
    """Rebuild damaged or missing data in the store at ``path``; intact data stay as they are.

    A repair that is killed damages no row: run it again. A recipe that may crash its process is
    simulated in another one, so call this under ``if __name__ == "__main__":``.

    Args:
        path: the store.
        workers: number of processes; with 1, most work is done in this process.
        accept_other_platform: also simulate rows of a platform with other bytes here; they are
            recorded as rows of this platform. Otherwise they stay as they are.
        on_start: called with the number of rows before each time they are verified.
        on_episode: called with the number of each row that is verified or simulated.

    Raises:
        UsageError: if there is no store.
        StoreError: if another process is writing to it, or the disk fails.
    """
    store = on_disk(path)
    with adding_how_to_continue(store):
        return _repair(store, workers, accept_other_platform, on_start, on_episode)


def _repair(
    path: Path,
    workers: int,
    accept: bool,
    on_start: Callable[[int], None],
    on_episode: Callable[[int], None],
) -> RepairReport:
    _tidy(path)
    left = leftovers(place_of(path))  # before anything is changed: links are refused here
    before = verify(path, workers=workers, on_start=on_start, on_episode=on_episode)
    if before.is_whole and not left:
        return RepairReport(before=before, after=before, mended=(), failed=(), remade=())
    with StoreLock(path):
        session = RepairSession(path, workers, on_episode, accept=accept)
        goes_on = session.run(before)
    if not goes_on:
        failed = tuple(session.failed)
        return RepairReport(before=before, after=before, mended=(), failed=failed, remade=())
    for name in sorted(_labels_of(before.problems)):
        _relabel(path, name, session)
    try:
        with StoreLock(path):
            pack(path)
    except GraspFactoryError as error:
        session.failed.append(f"columns are not packed: {error}")
    after = verify(path, workers=workers, on_start=on_start, on_episode=on_episode)
    return RepairReport(
        before=before,
        after=after,
        mended=tuple(session.mended),
        failed=tuple(session.failed),
        remade=tuple(session.remade),
    )


def _labels_of(problems: tuple[Problem, ...]) -> set[str]:
    """Return the names of the added labels with a problem."""
    places = [problem.array.split("/") for problem in problems]
    return {place[1] for place in places if place[0] == LABELS and len(place) > 1}


def _relabel(path: Path, name: str, session: RepairSession) -> None:
    """Rebuild an added label from its thresholds; if they are lost, it stays as it is."""
    folder = place_of(path) / LABELS / name
    thresholds = thresholds_of(path, name)
    if thresholds is None:
        session.failed.append(
            f"{LABELS}/{name} cannot be made again, its thresholds are lost: delete {folder}, and"
            f" run grasp-factory relabel --name {name}"
        )
        return
    damaged = folder.parent / f".{name}{DAMAGED}"
    folder.replace(damaged)
    try:
        relabel(path, name, from_plain(LabelConfig, thresholds))
    except GraspFactoryError as error:
        session.failed.append(f"{LABELS}/{name} cannot be made again: {error}")
    else:
        session.mended.append(f"{LABELS}/{name} is derived again from its thresholds")
    finally:
        _settle(damaged)


def _settle(damaged: Place) -> None:
    """Put a damaged label back; if it was rebuilt, remove the damaged one, except users' files."""
    folder = damaged.parent / damaged.name.removesuffix(DAMAGED)[1:]
    if not folder.exists():
        damaged.replace(folder)
        return
    for piece in damaged.glob("*"):
        if piece.name not in (FILE, *LABEL_COLUMNS):
            piece.replace(folder / piece.name)
    damaged.rmtree()


def _tidy(path: Path) -> None:
    """Remove or put back what a killed repair has left."""
    if not path.is_dir():
        return
    template = template_place(path)
    labels = (place_of(path) / LABELS).glob(f".*{DAMAGED}")
    left = [name for name in template.parent.names() if template.name in name]
    if not (labels or left):
        return
    with StoreLock(path):
        remove_template(template)
        for damaged in labels:
            _settle(damaged)
