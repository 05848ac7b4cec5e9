"""Checking blocks: one at a time, here or in worker processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from grasp_factory.core import schema
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.platforms import is_fingerprint
from grasp_factory.curation.verify.contents import (
    behind_problems,
    committed_problems,
    empty_lengths,
    fingerprint_problems,
    is_complete,
    is_whole,
    padded,
    padding_problems,
    quarantined_problems,
    read_block,
    trimmed,
)
from grasp_factory.curation.verify.invariants import faults
from grasp_factory.curation.verify.partial_store import PartialStore, open_pieces
from grasp_factory.curation.verify.problems import GENERATE, REPAIR, Problem
from grasp_factory.dataset.row_codec import Row, text_of
from grasp_factory.dataset.row_integrity import QUARANTINE_PATHS
from grasp_factory.writers.zarr.layout import block_files
from grasp_factory.writers.zarr.writer import COMMITTED, MISSING, QUARANTINED

UNKNOWN = -1
NOT_EMPTY = (*QUARANTINE_PATHS, schema.FINGERPRINT.path)
"""Paths at which a quarantined row has values."""
MAKER = "this version of grasp-factory wrote it so, or another program: make the episode again"
"""Advice for values that match their checksum and are impossible."""


@dataclass(slots=True, kw_only=True)
class Findings:
    """The results of checking some blocks."""

    committed: int = 0
    quarantined: int = 0
    missing: int = 0
    problems: list[Problem] = field(default_factory=list)
    fingerprints: Counter[str] = field(default_factory=Counter)
    """Rows by fingerprint."""


class BlockChecker:
    """Checks ranges of blocks of a store; it reports the number of each row that it has checked.

    Only the path is sent to a worker. Each process opens the store at its first block.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return BlockChecker, (self._path,)

    def __call__(self, blocks: range, report: SendMessage) -> Findings:
        """Check some blocks."""
        findings = Findings()
        for block in blocks:
            self._check(block, findings)
            for row in self._pieces.rows_of(block):
                report(row)
        return findings

    @cached_property
    def _pieces(self) -> PartialStore:
        return open_pieces(self._path)[0]

    @cached_property
    def _markers(self) -> frozenset[str]:
        """The names of the commit markers: a look at each takes long in a store of few blocks."""
        try:
            return frozenset((self._pieces.place / schema.STATUS.path).names())
        except (FileNotFoundError, NotADirectoryError):
            return frozenset()

    def _check(self, block: int, findings: Findings) -> None:
        pieces, numbers = self._pieces, self._pieces.rows_of(block)
        marker = block_files(pieces.place, schema.STATUS, block, numbers)[0]
        if marker.name not in self._markers:
            # The block was never finished, so its other files are not content.
            findings.missing += len(numbers)
            findings.problems.append(_missing(list(numbers)))
            return
        rows, unreadable = read_block(pieces, block)
        findings.problems += unreadable
        missing = []
        for i, row in zip(numbers, rows, strict=True):
            status = int(row.get(schema.STATUS.path, UNKNOWN))
            findings.committed += status == COMMITTED
            findings.quarantined += status == QUARANTINED
            findings.missing += status == MISSING
            # A block that is being extended already has values of rows that its marker lacks.
            if status != MISSING or not marker.partial.exists():
                findings.problems += row_problems(row, status, pieces, i)
            missing += [i] if status == MISSING else []
            text = text_of(row, schema.FINGERPRINT.path)
            findings.fingerprints.update([text] if is_fingerprint(text) else [])
        if missing:
            findings.problems.append(_missing(missing))
        findings.problems += behind_problems(pieces, block)


def row_problems(row: Row, status: int, pieces: PartialStore, i: int) -> Iterator[Problem]:
    """Yield the problems of a row, except that it is missing."""
    if status in (COMMITTED, QUARANTINED):
        yield from fingerprint_problems(row, pieces, i)
    if status == COMMITTED:
        yield from _committed_problems(row, pieces, i)
    elif status == UNKNOWN:
        return  # its status cannot be read, which is a problem already
    elif is_whole(row, trimmed(row, pieces.fields), pieces):
        what = f"{status}, though the row holds a whole episode"
        yield Problem(episode=i, array=schema.STATUS.path, what=what)
    elif status == QUARANTINED:
        yield from quarantined_problems(row, pieces, i)
        yield from padding_problems(row, empty_lengths(NOT_EMPTY, pieces), pieces, i)
    elif status == MISSING:
        yield from padding_problems(row, empty_lengths((), pieces), pieces, i)
    else:
        what = f"{status}, which stands for nothing"
        yield Problem(episode=i, array=schema.STATUS.path, what=what)


def _committed_problems(row: Row, pieces: PartialStore, i: int) -> Iterator[Problem]:
    contents = trimmed(row, pieces.fields)
    wrong = committed_problems(row, contents, pieces, i)
    if wrong:
        yield from wrong
        return
    yield from padding_problems(row, padded(row, pieces), pieces, i)
    if not is_complete(contents, pieces):
        return
    index, seed = (int(contents[f"episodes/{name}"]) for name in ("index", "seed"))
    is_moved = not pieces.is_collected and (index, seed) != (i, pieces.config.seed)
    try:
        for array, what in faults(contents, pieces, i):
            yield Problem(episode=i, array=array, what=what, advice=REPAIR if is_moved else MAKER)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        what = f"cannot be checked: {type(error).__name__}: {error}"
        yield Problem(episode=i, array="episodes/spec", what=what, advice=MAKER)


def _missing(rows: list[int]) -> Problem:
    one = rows[0] == rows[-1]
    what = "is missing" if one else f"is missing, as are others up to {rows[-1]}"
    return Problem(episode=rows[0], array=schema.STATUS.path, what=what, advice=GENERATE)
