"""Verification and repair of the annotation log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from grasp_factory.core.place import place_of
from grasp_factory.curation.verify.auxiliary_data import placeholder_problems
from grasp_factory.curation.verify.documents import FILE
from grasp_factory.curation.verify.partial_store import PartialStore
from grasp_factory.curation.verify.problems import REPAIR, Problem
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.annotations.carrying import HOW_TO_MEND
from grasp_factory.dataset.annotations.log_file import (
    DESCRIPTION,
    NAME,
    appending,
)
from grasp_factory.dataset.annotations.log_file import FOLDER as ANNOTATIONS
from grasp_factory.errors import IrregularFileError, StoreError
from grasp_factory.writers.zarr.placeholder import write_placeholder

LOG = f"{ANNOTATIONS}/{NAME}"
MOST_NAMED = 20
"""At most this many damaged lines are named one by one."""
_UNFINISHED = "its last line is unfinished: who wrote it was killed, or its end is lost"


def annotation_problems(pieces: PartialStore) -> Iterator[Problem]:
    """Yield a problem for each line of the log that is not a valid change of a row of the store."""
    path = pieces.path
    try:
        if not (pieces.place / ANNOTATIONS).is_dir():
            return
    except IrregularFileError as error:
        yield _problem("cannot be read", str(error))
        return
    yield from placeholder_problems(pieces.place, ANNOTATIONS)
    log = AnnotationLog(path)
    try:
        damaged, last = log.damaged(), max((change.row for change in log.changes()), default=-1)
    except StoreError as error:
        yield _problem("cannot be read", str(error))
        return
    for line, fault in damaged[:MOST_NAMED]:
        yield _problem(f"line {line} {fault}", HOW_TO_MEND)
    if len(damaged) > MOST_NAMED:
        yield _problem(f"{len(damaged) - MOST_NAMED} more of its lines are damaged", HOW_TO_MEND)
    if last >= pieces.rows:
        what = f"tells of row {last}, the store has {pieces.rows}"
        yield _problem(what, "it may be the log of another store: put the right one there")
    if not log.is_finished():
        yield _problem(_UNFINISHED, REPAIR)


def mend_annotations(path: Path, problems: Iterable[Problem]) -> tuple[list[str], list[str]]:
    """Repair all but the annotations themselves; return what was repaired, and what was not.

    Raises:
        StoreError: if the log cannot be written.
    """
    mended, failed = [], []
    for problem in problems:
        if problem.array == ANNOTATIONS:
            write_placeholder(place_of(path), ANNOTATIONS, DESCRIPTION)
            mended.append(f"{ANNOTATIONS}/{FILE} is made again")
        elif problem.array == LOG and problem.advice == REPAIR:
            with appending(path):
                mended.append(f"{LOG}: what is left of its last line is removed")
        elif problem.array == LOG:
            failed.append(f"{LOG}: {problem.what}: only people can mend that: {problem.advice}")
    return mended, failed


def _problem(what: str, advice: str) -> Problem:
    return Problem(episode=None, array=LOG, what=what, advice=advice)
