"""Repairing a store: what verifying finds is made again, and verified again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.errors import GraspFactoryError
from grasp_factory.factory import generate
from grasp_factory.records import from_plain
from grasp_factory.relabel import relabel
from grasp_factory.sections import LabelConfig
from grasp_factory.verifying.beside import LABELS, leftovers, thresholds_of
from grasp_factory.verifying.mending import Remade, checksums
from grasp_factory.verifying.pieces import open_pieces
from grasp_factory.verifying.problems import Problem, Report
from grasp_factory.verifying.surgery import Surgery
from grasp_factory.verifying.verification import verify
from grasp_factory.writers.lock import StoreLock
from grasp_factory.writers.packing import pack

DAMAGED = ".damaged"
"""Ends the name of a label's folder that is kept until the label is made again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Repaired:
    """What a repair found, did, and left."""

    before: Report
    after: Report
    mended: tuple[str, ...]
    """What was made again or removed, one line each."""
    failed: tuple[str, ...]
    """What could not be, and why."""
    remade: tuple[Remade, ...]
    """Episodes that were simulated again."""

    @property
    def is_whole(self) -> bool:
        """True when the store has no problem any more."""
        return self.after.is_whole


def repair(
    path: Path | str,
    workers: int = 1,
    *,
    on_start: Callable[[int], None] = lambda rows: None,
    on_episode: Callable[[int], None] = lambda row: None,
) -> Repaired:
    """Make again what is damaged or missing in the store at ``path``; what is whole stays.

    A repair that is killed leaves no row worse than it was: run it again. With more than one
    worker, call it under ``if __name__ == "__main__":``.

    Args:
        path: the store.
        workers: processes.
        on_start: called with the number of rows before each time they are verified.
        on_episode: called with the number of each row that is verified or simulated.

    Raises:
        UsageError: if there is no store.
        StoreError: if another process is writing to it, or the disk fails.
    """
    path = Path(path)
    _put_back_labels(path)
    before = verify(path, workers=workers, on_start=on_start, on_episode=on_episode)
    if before.is_whole and not leftovers(path):
        return Repaired(before=before, after=before, mended=(), failed=(), remade=())
    with StoreLock(path):
        surgery = Surgery(path, workers, on_episode)
        goes_on = surgery.run(before)
    if not goes_on:
        failed = tuple(surgery.failed)
        return Repaired(before=before, after=before, mended=(), failed=failed, remade=())
    remade = list(surgery.remade)
    if surgery.to_generate:
        remade += _generated(path, workers, surgery, on_episode)
    for name in sorted(_labels_of(before.problems)):
        _relabel(path, name, surgery)
    try:
        with StoreLock(path):
            pack(path)
    except GraspFactoryError as error:
        surgery.failed.append(f"columns are not packed: {error}")
    after = verify(path, workers=workers, on_start=on_start, on_episode=on_episode)
    return Repaired(
        before=before,
        after=after,
        mended=tuple(surgery.mended),
        failed=tuple(surgery.failed),
        remade=tuple(remade),
    )


def _generated(
    path: Path, workers: int, surgery: Surgery, on_episode: Callable[[int], None]
) -> list[Remade]:
    """Let the factory complete the store; return the episodes that it made."""
    pieces = open_pieces(path)[0]
    try:
        generate(
            pieces.config,
            pieces.rows,
            path,
            workers,
            max_failures=1.0,
            on_episode=lambda made: on_episode(made.index),
        )
    except GraspFactoryError as error:
        surgery.failed.append(f"{len(surgery.to_generate)} rows cannot be made again: {error}")
        return []
    pieces = open_pieces(path)[0]
    after = {
        row: text for block in surgery.blocks for row, text in checksums(pieces, block).items()
    }
    return [
        Remade(episode=row, before=before, after=after[row])
        for row, before in surgery.to_generate.items()
    ]


def _labels_of(problems: tuple[Problem, ...]) -> set[str]:
    """Return the names of the added labels with a problem."""
    places = [problem.array.split("/") for problem in problems]
    return {place[1] for place in places if place[0] == LABELS and len(place) > 1}


def _relabel(path: Path, name: str, surgery: Surgery) -> None:
    """Make an added label again from its thresholds; without any, remove it."""
    folder = path / LABELS / name
    kept = folder.with_name(f".{name}{DAMAGED}")
    thresholds = thresholds_of(path, name)
    os.replace(folder, kept)
    if thresholds is None:
        shutil.rmtree(kept)
        surgery.failed.append(
            f"{LABELS}/{name} is removed, its thresholds are lost: make it again with grasp-factory"
            f" relabel --name {name}"
        )
        return
    try:
        relabel(path, name, from_plain(LabelConfig, thresholds))
    except GraspFactoryError as error:
        os.replace(kept, folder)
        surgery.failed.append(f"{LABELS}/{name} cannot be made again: {error}")
        return
    shutil.rmtree(kept)
    surgery.mended.append(f"{LABELS}/{name} is derived again from its thresholds")


def _put_back_labels(path: Path) -> None:
    """Put back the labels that a killed repair had begun to make again."""
    for kept in sorted((path / LABELS).glob(f".*{DAMAGED}")):
        with StoreLock(path):
            folder = kept.with_name(kept.name.removesuffix(DAMAGED)[1:])
            if folder.exists():
                shutil.rmtree(kept)
            else:
                os.replace(kept, folder)
