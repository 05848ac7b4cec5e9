"""Computing the current annotations from changes, in a time that is linear in their number."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.annotations.records import Annotation, Change, Mark


def fold(changes: Iterable[Change]) -> dict[int, Annotation]:
    """Return the annotations after some changes, by row; rows with nothing set are left out.

    The order of the changes counts, not their times.
    """
    out: dict[int, Annotation] = {}
    fold_in(out, changes)
    return out


def fold_in(annotations: dict[int, Annotation], changes: Iterable[Change]) -> list[Change]:
    """Apply changes to the annotations, by row; return those that had an effect."""
    open_rows: dict[int, _Standing] = {}
    effective = []
    for change in changes:
        standing = open_rows.get(change.row)
        if standing is None:
            standing = open_rows[change.row] = _Standing(annotations.get(change.row))
        if standing.apply(change):
            effective.append(change)
    for row, standing in open_rows.items():
        after = standing.annotation(row)
        if after.is_empty:
            annotations.pop(row, None)
        else:
            annotations[row] = after
    return effective


def unfold(annotation: Annotation) -> list[Change]:
    """Return changes that make the annotation of nothing; ``fold`` is the inverse.

    All of them have the time and the person of its last change.
    """
    values: list[tuple[str, Any]] = [
        *(("tag", tag) for tag in annotation.tags),
        ("note", annotation.note),
        ("quality", annotation.quality),
        ("outcome", annotation.outcome),
        *(("mark", to_plain(mark)) for mark in annotation.marks),
    ]
    return [
        Change(
            when=annotation.changed,
            who=annotation.by,
            row=annotation.row,
            kind=kind,
            value=value,
        )
        for kind, value in values
        if value not in (None, "")
    ]


class _Standing:
    """The annotation of a row while changes are applied to it."""

    __slots__ = ("_by", "_changed", "_marks", "_tags", "_values")

    def __init__(self, before: Annotation | None) -> None:
        old = before or Annotation(row=0)
        self._tags, self._marks = set(old.tags), {mark.id: mark for mark in old.marks}
        self._values: dict[str, Any] = {
            "note": old.note,
            "quality": old.quality,
            "outcome": old.outcome,
        }
        self._changed, self._by = old.changed, old.by

    def apply(self, change: Change) -> bool:
        """Apply a change; return whether it had an effect."""
        if not self._set(change.kind, change.value):
            return False
        self._changed, self._by = change.when, change.who
        return True

    def annotation(self, row: int) -> Annotation:
        """Return the annotation as it stands."""
        return Annotation(
            row=row,
            tags=tuple(sorted(self._tags)),
            marks=tuple(self._marks.values()),
            changed=self._changed,
            by=self._by,
            **self._values,
        )

    def _set(self, kind: str, value: Any) -> bool:
        match kind:
            case "tag":
                is_new = value not in self._tags
                self._tags.add(value)
                return is_new
            case "untag":
                had = value in self._tags
                self._tags.discard(value)
                return had
            case "mark":
                mark = Mark(**value)
                old, self._marks[mark.id] = self._marks.get(mark.id), mark
                return mark != old
            case "unmark":
                return self._marks.pop(value, None) is not None
            case _:  # note, quality, outcome: the last one counts
                before, self._values[kind] = self._values[kind], value
                return bool(value != before)
