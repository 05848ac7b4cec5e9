"""The log of a store's annotations: reading the current ones, and appending changes."""

from __future__ import annotations

import getpass
import os
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.serialization import is_integer
from grasp_factory.dataset.annotations.change_checks import check_place
from grasp_factory.dataset.annotations.folding import fold_in
from grasp_factory.dataset.annotations.lines import decode, encode, now
from grasp_factory.dataset.annotations.log_file import append, appending, log_file, reading
from grasp_factory.dataset.annotations.records import Annotation, Change
from grasp_factory.dataset.annotations.values import checked, checked_who
from grasp_factory.errors import UsageError, shown

USER = "GRASP_FACTORY_USER"
"""Environment variable with the name of the person who makes changes."""
MOST_CHANGES = 100
"""Maximum number of changes in one call, for each of its rows."""
MOST_TAGS, MOST_MARKS = 64, 500
"""Maximum numbers of tags and of marks of one episode."""
_TAIL = 256
"""How many of the last bytes read are compared, to detect that the file was replaced."""


@dataclass(slots=True)
class _Seen:
    """The part of the file that was read so far, in whole lines."""

    file: tuple[int, int] | None = None
    """Device and inode of the file."""
    size: int = 0
    tail: bytes = b""
    lines: int = 0
    changes: list[Change] = field(default_factory=list)
    damaged: list[tuple[int, str]] = field(default_factory=list)
    annotations: dict[int, Annotation] = field(default_factory=dict)
    is_finished: bool = True

    def take(self, data: bytes) -> None:
        """Add the whole lines of data that follows; an unfinished last line is left for later."""
        end, first = data.rfind(b"\n") + 1, len(self.changes)
        for line in data[:end].split(b"\n")[:-1]:
            self.lines += 1
            try:
                self.changes.append(decode(line))
            except ValueError as error:
                self.damaged.append((self.lines, str(error)))
        fold_in(self.annotations, self.changes[first:])
        self.size += end
        self.tail = (self.tail + data[:end])[-_TAIL:]
        self.is_finished = end == len(data)


class AnnotationLog:
    """Annotations of a store's episodes by people: an append-only file in the store.

    Several processes and threads may read and append at the same time. Reading skips damaged lines
    and an unfinished last line. ``damaged`` lists the damaged lines; ``grasp-factory verify``
    reports both. Each read continues after the part that was read before.

    Attributes:
        store: the path of the store.
    """

    def __init__(self, store: Path | str) -> None:
        """Use the store at ``store``; nothing is read yet, and the log need not exist."""
        self.store = store_path(store)
        self._seen, self._lock = _Seen(), threading.Lock()

    def changes(self) -> list[Change]:
        """Return every change, in the order in which they were made.

        Raises:
            StoreError: if the log cannot be read.
        """
        return list(self._read().changes)

    def annotations(self) -> dict[int, Annotation]:
        """Return the current annotations, by row; rows with nothing set are left out.

        Raises:
            StoreError: if the log cannot be read.
        """
        return dict(self._read().annotations)

    def of(self, row: int) -> Annotation | None:
        """Return the current annotation of one row; None if nothing is set.

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
        """Return the number, from 1, and the fault of each line that is not a valid change.

        Raises:
            StoreError: if the log cannot be read.
        """
        return list(self._read().damaged)

    def is_finished(self) -> bool:
        """Return whether the last line has its line break.

        If not, the line is being written, or its writer was killed.

        Raises:
            StoreError: if the log cannot be read.
        """
        return self._read().is_finished

    def state(self) -> tuple[int, int]:
        """Return size [bytes] and change time [ns] of the log; (0, 0) if there is none.

        This is a cheap way to find out whether anything was added.
        """
        try:
            found = log_file(self.store).stat()
        except OSError:
            return 0, 0
        return found.st_size, found.st_ctime_ns

    def append(
        self, who: str, rows: Iterable[int], changes: Sequence[tuple[str, Any]]
    ) -> dict[int, Annotation | None]:
        """Make changes to some episodes: all changes or, if anything is invalid, none.

        A change without effect, such as a tag that is already set, is not written.

        Args:
            who: the name of the person.
            rows: the rows of committed or quarantined episodes.
            changes: kind and value of each change, as in ``KINDS``; all are made to each row.

        Returns:
            The annotations after the changes, by row; None for rows with nothing set.

        Raises:
            UsageError: for an invalid row, name, kind or value, or if there is no store.
            StoreError: if the log cannot be written, or would be too large to read; it is then
                unchanged.
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
                after, lines = self._planned(name, places, wanted)  # the log may have grown
                append(self.store, descriptor, b"".join(lines))
        return {row: after.get(row) for row in places}

    def _planned(
        self, who: str, rows: Sequence[int], changes: Sequence[tuple[str, Any]]
    ) -> tuple[dict[int, Annotation], list[bytes]]:
        """Return the annotations of some rows after changes, and the lines of effective changes."""
        standing, when = self._read().annotations, now()
        after = {row: standing[row] for row in rows if row in standing}
        lines: list[bytes] = []
        for row in rows:
            mine = (Change(when=when, who=who, row=row, kind=k, value=v) for k, v in changes)
            lines += map(encode, fold_in(after, mine))
            _check_amount(row, standing.get(row), after.get(row))
        return after, lines

    def _read(self) -> _Seen:
        """Read what was appended since the last read; the whole file if it was replaced."""
        with self._lock, reading(self.store) as descriptor:
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
    """Return the name of the person who makes changes: ``$GRASP_FACTORY_USER`` or the account's."""
    if name := os.environ.get(USER, ""):
        return name
    try:
        return getpass.getuser()
    except (KeyError, OSError, ImportError):  # an account without a name
        return "unknown"


def _check_amount(row: int, before: Annotation | None, after: Annotation | None) -> None:
    """Check that a change does not leave a row with too many tags or marks.

    A row that already had too many may keep them, but must not get more.

    Raises:
        UsageError: if there are too many.
    """
    for name, most in (("tags", MOST_TAGS), ("marks", MOST_MARKS)):
        count = len(getattr(after, name, ()))
        if count > max(most, len(getattr(before, name, ()))):
            raise UsageError(f"episode {row} would have {count} {name}, valid: up to {most}")


def _checked_rows(rows: Iterable[int]) -> list[int]:
    """Return rows in ascending order, without duplicates."""
    given = list(rows)
    for row in given:
        if not is_integer(row):
            raise UsageError(f"row {shown(row)}: valid: a number of an episode, such as 17")
    return sorted({int(row) for row in given})
