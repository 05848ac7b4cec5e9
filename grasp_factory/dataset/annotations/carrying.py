"""Copying the annotations of some rows into a new store."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from grasp_factory.dataset.annotations.lines import encode
from grasp_factory.dataset.annotations.log import AnnotationLog
from grasp_factory.dataset.annotations.log_file import FOLDER, NAME, replace_log
from grasp_factory.dataset.annotations.records import Change
from grasp_factory.errors import StoreError

HOW_TO_MEND = "nothing tells what it said: look at it, then delete that line"


def check_log(store: Path) -> AnnotationLog:
    """Return the log of the store at ``store``, in which every line is a valid change.

    Raises:
        StoreError: naming the first line that is not.
    """
    log = AnnotationLog(store)
    for line, fault in log.damaged()[:1]:
        where = f"{store / FOLDER / NAME}, line {line}"
        raise StoreError(f"{where} {fault}; {HOW_TO_MEND}")
    return log


def carry(from_store: Path, to_store: Path, rows: Mapping[int, int]) -> int:
    """Add the changes of some rows to the log of a store that is being made.

    That log is ordered by time; changes of one store keep their order. A change that the log
    already has, from another store with the same episode, is not added.

    Args:
        from_store: the store that has the changes.
        to_store: the new store, which no other process uses yet.
        rows: the row in ``to_store`` of each row of ``from_store``; changes of other rows are left
            out.

    Returns:
        How many changes were added.

    Raises:
        StoreError: if a line of the log is damaged, or the disk fails.
    """
    log = check_log(from_store)
    mine = [replace(change, row=rows[change.row]) for change in log.changes() if change.row in rows]
    there = AnnotationLog(to_store).changes()
    known = Counter(map(encode, there))
    new = []
    for change in mine:
        line = encode(change)
        if known[line]:
            known[line] -= 1
        else:
            new.append(change)
    if not new:
        return 0
    write_log(to_store, heapq.merge(there, new, key=lambda change: change.when))
    return len(new)


def write_log(store: Path, changes: Iterable[Change]) -> None:
    """Write the log of a store that is being made, which no other process uses yet.

    Raises:
        StoreError: if the disk fails.
        LimitError: if readers would refuse the log.
    """
    try:
        replace_log(store, b"".join(map(encode, changes)))
    except OSError as error:
        raise StoreError(f"{store / FOLDER} cannot be written: {error.strerror}") from None
