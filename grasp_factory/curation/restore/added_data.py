"""What people and ``relabel`` added to the episodes of an export: labels and annotations."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.limits import LABELS
from grasp_factory.core.serialization import from_plain
from grasp_factory.curation.merge.label_transfer import CopiedLabel
from grasp_factory.dataset.annotations import Annotation, Change
from grasp_factory.dataset.annotations.change_checks import check_place
from grasp_factory.dataset.annotations.folding import unfold
from grasp_factory.dataset.annotations.lines import decode, encode
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.label_columns import LONGEST_NAME, NOT_LABELLED, label_thresholds


def labels_of(path: Path, record: Mapping[str, Any], rows: int) -> tuple[CopiedLabel, ...]:
    """Return the added labels of an export; an episode that a label does not cover has 255.

    A label whose thresholds are not the same in all stores that have it is there without them.

    Args:
        path: the export, for messages.
        record: its record.
        rows: number of its episodes.

    Raises:
        AttributeError, KeyError, TypeError, ValueError, StoreError: if the record is damaged.
    """
    LABELS.check(len(record["labels"]), path)
    codes: dict[Any, int] = {name: code for code, name in enumerate(names(Outcome))}
    codes[None] = NOT_LABELLED
    found = []
    for name, words in record["labels"].items():
        if not name.isidentifier() or len(name) > LONGEST_NAME or len(words) != rows:
            raise ValueError(f"the label {name[:LONGEST_NAME]!r} has {len(words)} values")
        outcome = np.array([codes[word] for word in words], np.uint8)
        stores = [store.get("label_thresholds", {}) for store in record["stores"]]
        made_with = [thresholds[name] for thresholds in stores if name in thresholds]
        is_one = bool(made_with) and all(other == made_with[0] for other in made_with)
        attributes = {"thresholds": made_with[0] if is_one else {}}
        thresholds = label_thresholds(f"{path}: the label {name}", attributes)
        found.append(CopiedLabel(name=name, outcome=outcome, thresholds=thresholds))
    return tuple(found)


def changes_of(record: Mapping[str, Any], rows: int) -> list[Change]:
    """Return the changes that make the annotations of an export, in the order of time.

    Args:
        record: the record of the export.
        rows: number of its episodes.

    Raises:
        AttributeError, TypeError, ValueError, KeyError: if the record is damaged.
    """
    changes = []
    for place, said in record["annotations"].items():
        row = int(place)
        if not 0 <= row < rows:
            raise ValueError(f"annotations: got episode {row}, valid: 0 to {rows - 1}")
        annotation = from_plain(Annotation, {**said, "row": row}, "annotations")
        changes += [decode(encode(change).rstrip(b"\n")) for change in unfold(annotation)]
    return sorted(changes, key=lambda change: (change.when, change.row))


def check_changes(store: Path, changes: list[Change]) -> None:
    """Check that changes are of rows and images that a store has.

    Raises:
        ValueError: naming what it lacks.
    """
    if not changes:
        return
    try:
        rows = sorted({change.row for change in changes})
        check_place(store, rows, [(change.kind, change.value) for change in changes])
    except UsageError as error:
        raise ValueError(str(error)) from None
