"""Transfer of annotations together with their rows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.union import Integers, RowPlan
from grasp_factory.dataset.annotations import AnnotationLog, carry
from grasp_factory.dataset.annotations.carrying import check_log


def check_annotations(sources: Iterable[SourceStore]) -> None:
    """Check that no annotation log is damaged, before any row is copied.

    Raises:
        StoreError: naming the damaged line.
    """
    for source in sources:
        check_log(source.path)


def carry_annotations(
    sources: Sequence[SourceStore], plan: RowPlan, repeats: tuple[RowPlan, RowPlan], store: Path
) -> int:
    """Copy the annotations of the rows to the new store; return how many rows have any.

    A row that several stores have gets the annotations of all of them, in the order of time.

    Args:
        sources: the stores.
        plan: where each row of the new store comes from.
        repeats: rows that are left out, and the rows that replace them.
        store: where the new store is made.

    Raises:
        StoreError: if annotations are damaged, or the disk fails.
    """
    for k, source in enumerate(sources):
        said = {change.row for change in AnnotationLog(source.path).changes()}
        if said:
            rows = np.array(sorted(said), np.int64)
            carry(source.path, store, new_rows(k, rows, plan, repeats))
    return len(AnnotationLog(store).annotations())


def new_rows(
    k: int, rows: Integers, plan: RowPlan, repeats: tuple[RowPlan, RowPlan]
) -> dict[int, int]:
    """Return the new numbers of some rows of store ``k``, by row; rows without one are left out.

    Args:
        k: the store's position.
        rows: some of its rows.
        plan: where each row of the new store comes from.
        repeats: rows that are left out, and the rows that replace them.
    """
    place = np.flatnonzero((plan.store == k) & np.isin(plan.row, rows))
    found = dict(zip(plan.row[place].tolist(), place.tolist(), strict=True))
    mine = np.flatnonzero((repeats[0].store == k) & np.isin(repeats[0].row, rows))
    left_out, kept = (side[mine] for side in repeats)
    near = np.flatnonzero(np.isin(plan.row, kept.row))
    places = dict(zip(_names(plan[near]), near.tolist(), strict=True))
    twins = zip(left_out.row.tolist(), _names(kept), strict=True)
    return found | {row: places[twin] for row, twin in twins}


def _names(rows: RowPlan) -> Iterator[tuple[int, int]]:
    return zip(rows.store.tolist(), rows.row.tolist(), strict=True)
