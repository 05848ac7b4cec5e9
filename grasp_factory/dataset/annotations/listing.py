"""Annotations as lists: counts of tags, JSON records, CSV."""

from __future__ import annotations

import io
import json
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from grasp_factory.core.csv_text import CsvWriter
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.annotations.records import Annotation, Change
from grasp_factory.dataset.counts import most_frequent_first

COLUMNS = ("row", "tags", "note", "quality", "outcome", "marks", "changed", "by")
HISTORY = Change.__slots__


def tag_counts(annotations: Iterable[Annotation]) -> dict[str, int]:
    """Return how many episodes have each tag, the most frequent first."""
    counts = Counter(tag for said in annotations for tag in said.tags)
    return most_frequent_first(counts)


def summary(annotations: Sequence[Annotation]) -> dict[str, int]:
    """Return how many episodes are annotated, and how many have each kind of annotation."""
    return {
        "annotated": len(annotations),
        "tagged": sum(bool(said.tags) for said in annotations),
        "with a note": sum(bool(said.note) for said in annotations),
        "with a quality": sum(said.quality is not None for said in annotations),
        "with a corrected outcome": sum(said.outcome is not None for said in annotations),
        "with marks": sum(bool(said.marks) for said in annotations),
    }


def annotations_csv(annotations: Iterable[Annotation]) -> str:
    """Return CSV with a header and a line for each annotation.

    Tags are separated by commas, marks are JSON.
    """
    records = [to_plain(said) for said in annotations]
    for record in records:
        record["tags"] = ",".join(record["tags"])
        record["marks"] = json.dumps(record["marks"], ensure_ascii=False) if record["marks"] else ""
    return _csv(COLUMNS, records)


def changes_csv(changes: Iterable[Change]) -> str:
    """Return CSV with a header and a line for each change; values other than text are JSON."""
    records = [to_plain(change) for change in changes]
    for record in records:
        if not isinstance(record["value"], str):
            record["value"] = json.dumps(record["value"], ensure_ascii=False)
    return _csv(HISTORY, records)


def change_text(change: Change) -> str:
    """Return the value of a change as one line of text."""
    value = change.value
    if change.kind == "mark":
        pixels = ", ".join(f"{number:g}" for number in value["pixels"])
        label = f" {value['label']}" if value["label"] else ""
        return f"{value['shape']}{label} on {value['camera']} {value['frame']} at {pixels}"
    if value is None or value == "":
        return "cleared"
    return " ".join(str(value).split())


def _csv(columns: Sequence[str], records: Iterable[dict[str, Any]]) -> str:
    out = io.StringIO()
    writer = CsvWriter(out)
    writer.row(columns)
    for record in records:
        writer.row(record[name] for name in columns)
    return out.getvalue()
