"""What people said of the rows, carried over with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.union import Integers, RowPlan
from grasp_factory.dataset.annotations import AnnotationLog, carry
from grasp_factory.dataset.annotations.carrying import check_log


def check_annotations(sources: Iterable[SourceStore]) -> None:
    """Check that nothing of what people said is damaged, before any row is copied.

    Raises:
        StoreError: naming the line that is.
    """
    for source in sources:
        check_log(source.path)


def carry_annotations(
    sources: Sequence[SourceStore], plan: RowPlan, repeats: tuple[RowPlan, RowPlan], store: Path
) -> int:
    """Give the new store the annotations of its rows, and return how many rows have any.

    A row that several stores have gets those of all, in the order of time.

    Args:
        sources: the stores.
        plan: where each row of the new store comes from.
        repeats: rows that are left out, and those that are in their place.
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
    """Return where some rows of store ``k`` have come to, by row; those that have not are left out.

    Args:
        k: the store's position.
        rows: rows of it.
        plan: where each row of the new store comes from.
        repeats: rows that are left out, and those that are in their place.
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
