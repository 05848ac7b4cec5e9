"""Comparing a store with one of its snapshots."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.text_format import count
from grasp_factory.curation.versions.comparing import compare
from grasp_factory.curation.versions.difference import Difference
from grasp_factory.dataset.snapshots import PresentVersion, SnapshotFolder
from grasp_factory.dataset.snapshots.naming import stored_version
from grasp_factory.dataset.snapshots.snapshot import LogState
from grasp_factory.dataset.snapshots.snapshot_folder import SHORT
from grasp_factory.dataset.snapshots.version import log_bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class SnapshotReport:
    """How a store agrees with one of its snapshots."""

    id: str
    problems: tuple[tuple[int | None, str], ...]
    """Row, or None for the whole store, and what is not as in the snapshot."""
    notes: tuple[str, ...]


def check_snapshot(store: Path, prefix: str) -> SnapshotReport:
    """Compare a store with the snapshot whose id begins with ``prefix``.

    What was added since then is no problem: rows, labels and lines of the annotation log.

    Raises:
        UsageError: if there is no such snapshot, or no store.
        StoreError: if the snapshot or the store's columns are damaged.
    """
    then = stored_version(SnapshotFolder.of(store), prefix)
    now = PresentVersion(store)
    found = compare(then, now, arrays=True)
    log = then.contents.annotations
    problems = [*_row_problems(found), *((None, text) for text in found.settings)]
    problems += [
        (None, f"labels/{name} was {word}")
        for name, word in found.labels.items()
        if word != "added"
    ]
    if log is not None and not _has_grown_from(store, log):
        problems.append((None, f"annotations: {found.annotations}, the old lines are others"))
    named = f"snapshot {then.id[:SHORT]}"
    return SnapshotReport(
        id=then.id,
        problems=tuple((row, f"{text} since {named}") for row, text in problems),
        notes=tuple(f"{text} since {named}" for text in _notes(found)),
    )


def _row_problems(found: Difference) -> Iterator[tuple[int | None, str]]:
    for row, _, _ in found.removed.tolist():
        yield row, "removed"
    arrays = ", ".join(found.arrays or ())
    for row, _, _ in found.changed.tolist():
        yield row, f"changed (arrays of all changed rows: {arrays or 'none'})"


def _notes(found: Difference) -> Iterator[str]:
    if len(found.added):
        yield f"{count(len(found.added), 'row')} added"
    for name, word in found.labels.items():
        if word == "added":
            yield f"labels/{name} added"
    if found.annotations:
        yield f"annotations: {found.annotations}"


def _has_grown_from(store: Path, log: LogState) -> bool:
    """Return whether the log of a store begins with the lines that it had."""
    return hashlib.sha256(log_bytes(store)[: log.bytes]).hexdigest() == log.sha256
