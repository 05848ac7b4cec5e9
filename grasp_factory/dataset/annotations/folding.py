"""Computing the current annotations from changes, with pure functions."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from grasp_factory.core.serialization import from_plain
from grasp_factory.dataset.annotations.records import Annotation, Change, Mark


def fold(changes: Iterable[Change]) -> dict[int, Annotation]:
    """Return the annotations after some changes, by row; rows with nothing set are left out.

    The order of the changes counts, not their times.
    """
    out: dict[int, Annotation] = {}
    for change in changes:
        fold_in(out, change)
    return out


def fold_in(annotations: dict[int, Annotation], change: Change) -> bool:
    """Apply one change to the annotations; return whether it had an effect."""
    before = annotations.get(change.row)
    after = changed(before, change)
    if after is None:
        annotations.pop(change.row, None)
    else:
        annotations[change.row] = after
    return after is not before


def changed(before: Annotation | None, change: Change) -> Annotation | None:
    """Return the annotation of an episode after a change; None if nothing is set.

    If the change has no effect, return ``before`` itself.
    """
    old = before or Annotation(row=change.row)
    new = _with(old, change)
    if new == old:
        return before
    return None if new.is_empty else replace(new, changed=change.when, by=change.who)


def _with(old: Annotation, change: Change) -> Annotation:
    value = change.value
    match change.kind:
        case "tag":
            at = bisect_left(old.tags, value)
            if old.tags[at : at + 1] == (value,):
                return old
            more: dict[str, Any] = {"tags": (*old.tags[:at], value, *old.tags[at:])}
        case "untag":
            more = {"tags": tuple(tag for tag in old.tags if tag != value)}
        case "mark":
            marks = {mark.id: mark for mark in old.marks} | {value["id"]: from_plain(Mark, value)}
            more = {"marks": tuple(marks.values())}
        case "unmark":
            more = {"marks": tuple(mark for mark in old.marks if mark.id != value)}
        case kind:  # note, quality, outcome: the last one counts
            more = {kind: value}
    return replace(old, **more)
