"""The log of a store's annotations: reading what stands, and adding to it."""

from __future__ import annotations

import getpass
import os
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.annotations.folding import fold_in
from grasp_factory.dataset.annotations.lines import decode, encode, now
from grasp_factory.dataset.annotations.log_file import append, appending, log_file, reading
from grasp_factory.dataset.annotations.place import check_place
from grasp_factory.dataset.annotations.records import Annotation, Change
from grasp_factory.dataset.annotations.values import checked, checked_who
from grasp_factory.errors import UsageError, shown

USER = "GRASP_FACTORY_USER"
"""Environment variable with the name of who makes changes."""
MOST_CHANGES = 100
"""In one call, to each of its rows."""
MOST_TAGS, MOST_MARKS = 64, 500
"""Of one episode."""
_TAIL = 256
"""Bytes before the end of what was read that tell whether the file is still the same."""


@dataclass(slots=True)
class _Seen:
    """What was read of the file so far: whole lines only."""

    file: tuple[int, int] | None = None
    """Its device and inode."""
    size: int = 0
    tail: bytes = b""
    lines: int = 0
    changes: list[Change] = field(default_factory=list)
    damaged: list[tuple[int, str]] = field(default_factory=list)
    annotations: dict[int, Annotation] = field(default_factory=dict)
    is_finished: bool = True

    def take(self, data: bytes) -> None:
        """Read on: whole lines, and what is there of the last one."""
        end = data.rfind(b"\n") + 1
        for line in data[:end].split(b"\n")[:-1]:
            self.lines += 1
            try:
                change = decode(line)
            except ValueError as error:
                self.damaged.append((self.lines, str(error)))
                continue
            self.changes.append(change)
            fold_in(self.annotations, change)
        self.size += end
        self.tail = (self.tail + data[:end])[-_TAIL:]
        self.is_finished = end == len(data)


class AnnotationLog:
    """What people say of a store's episodes: an append-only file in the store.

    Several processes and threads may read and append at once. Reading goes on past lines that are
    damaged, and does not see a last line that is unfinished; ``damaged`` names the former, and
    ``grasp-factory verify`` both. Only what was appended since is read again.

    Attributes:
        store: where the store is.
    """

    def __init__(self, store: Path | str) -> None:
        """Read nothing yet; a store without annotations has no log."""
        self.store = Path(store)
        self._file = log_file(self.store)
        self._seen, self._lock = _Seen(), threading.Lock()

    def changes(self) -> list[Change]:
        """Return every change, in the order in which they were made.

        Raises:
            StoreError: if the log cannot be read.
        """
        return list(self._read().changes)

    def annotations(self) -> dict[int, Annotation]:
        """Return what stands, by row; rows with nothing set are not in it.

        Raises:
            StoreError: if the log cannot be read.
        """
        return dict(self._read().annotations)

    def of(self, row: int) -> Annotation | None:
        """Return what stands of one row; None if nothing is set.

        Raises:
            StoreError: if the log cannot be read.
        """
        return self._read().annotations.get(row)

    def history(self, row: int) -> list[Change]:
        """Return the changes of one row, in the order in which they were made.

        Raises:
            StoreError: if the log cannot be read.
        """
        return [change for change in self._read().changes if change.row == row]

    def damaged(self) -> list[tuple[int, str]]:
        """Return number and fault of each line that stands for no change, counted from 1.

        Raises:
            StoreError: if the log cannot be read.
        """
        return list(self._read().damaged)

    def is_finished(self) -> bool:
        """Say whether the last line has its line break: else its writer is at it, or was killed.

        Raises:
            StoreError: if the log cannot be read.
        """
        return self._read().is_finished

    def state(self) -> tuple[int, int]:
        """Return size and time of change [ns] of the log, (0, 0) if there is none.

        That tells cheaply whether anything was added.
        """
        try:
            found = self._file.stat()
        except OSError:
            return 0, 0
        return found.st_size, found.st_mtime_ns

    def append(
        self, who: str, rows: Iterable[int], changes: Sequence[tuple[str, Any]]
    ) -> dict[int, Annotation | None]:
        """Make changes to some episodes: all of them or, if anything is wrong, none.

        What changes nothing, such as a tag that is there already, is not written.

        Args:
            who: the person.
            rows: of episodes that are committed or quarantined.
            changes: kind and value of each, as in ``KINDS``; all are made to each row.

        Returns:
            What stands now, by row; None where nothing is set.

        Raises:
            UsageError: for a row, a name, a kind or a value that is none, or if there is no store.
            StoreError: if the log cannot be written; then it is as it was.
        """
        name, places = checked_who(who), _checked_rows(rows)
        wanted = [(kind, checked(kind, value)) for kind, value in changes]
        if not wanted:
            raise UsageError("no changes: name a tag, a note, or what else shall be set")
        if len(wanted) > MOST_CHANGES:
            raise UsageError(f"got {len(wanted)} changes, valid: up to {MOST_CHANGES} at once")
        if not places:
            return {}
        check_place(self.store, places, wanted)
        after, lines = self._planned(name, places, wanted)
        if lines:
            with appending(self.store) as descriptor:
                after, lines = self._planned(name, places, wanted)  # others may have been quicker
                append(descriptor, b"".join(lines))
        return {row: after.get(row) for row in places}

    def _planned(
        self, who: str, rows: Sequence[int], changes: Sequence[tuple[str, Any]]
    ) -> tuple[dict[int, Annotation], list[bytes]]:
        """Return what will stand of some rows, and the lines of what changes anything."""
        standing, when = self._read().annotations, now()
        after = {row: standing[row] for row in rows if row in standing}
        lines = []
        for row in rows:
            for kind, value in changes:
                change = Change(when=when, who=who, row=row, kind=kind, value=value)
                if fold_in(after, change):
                    lines.append(encode(change))
            _check_amount(row, standing.get(row), after.get(row))
        return after, lines

    def _read(self) -> _Seen:
        """Read what has been appended since; all of it if the file is another one."""
        with self._lock, reading(self._file) as descriptor:
            if descriptor is None:
                self._seen = _Seen()
                return self._seen
            found = os.fstat(descriptor)
            file, seen = (found.st_dev, found.st_ino), self._seen
            tail = os.pread(descriptor, len(seen.tail), seen.size - len(seen.tail))
            if seen.file != file or tail != seen.tail:
                self._seen = seen = _Seen(file=file)
            with open(descriptor, "rb", closefd=False) as opened:
                opened.seek(seen.size)
                seen.take(opened.read())
            return seen


def default_who() -> str:
    """Return the name of who makes changes: ``$GRASP_FACTORY_USER``, or the account's."""
    if name := os.environ.get(USER, ""):
        return name
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # an account without a name
        return "unknown"


def _check_amount(row: int, before: Annotation | None, after: Annotation | None) -> None:
    """Check that a row has not come to have too many tags or marks; fewer than before are fine.

    Raises:
        UsageError: if it has.
    """
    for name, most in (("tags", MOST_TAGS), ("marks", MOST_MARKS)):
        count = len(getattr(after, name, ()))
        if count > max(most, len(getattr(before, name, ()))):
            raise UsageError(f"episode {row} would have {count} {name}, valid: up to {most}")


def _checked_rows(rows: Iterable[int]) -> list[int]:
    """Return rows, ascending, each once."""
    given = list(rows)
    for row in given:
        if not is_integer(row):
            raise UsageError(f"row {shown(row)}: valid: a number of an episode, such as 17")
    return sorted({int(row) for row in given})
