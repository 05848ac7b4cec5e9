"""Writing a planned store block by block, and reading each block back."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.episode import Episode
from grasp_factory.core.serialization import to_plain
from grasp_factory.core.simulated_row import with_room_for_real
from grasp_factory.curation.merge.annotation_transfer import carry_annotations, check_annotations
from grasp_factory.curation.merge.label_transfer import carried_labels
from grasp_factory.curation.merge.provenance import SeedSource
from grasp_factory.curation.merge.result import Collected
from grasp_factory.curation.merge.source_store import SourceStore
from grasp_factory.curation.merge.staged_store import StagedStore
from grasp_factory.curation.merge.union import NOBODY, RowPlan
from grasp_factory.dataset.row_reader import RowReader, StoredRow, mending
from grasp_factory.errors import LimitError, StoreError
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.embedded import embedded_in, open_embedded
from grasp_factory.writers.zarr.header import SOURCES, open_store, read_array
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, values_digest
from grasp_factory.writers.zarr.segment_packing import pack
from grasp_factory.writers.zarr.store import create_store
from grasp_factory.writers.zarr.writer import ZarrWriter


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """A merged or split store to build."""

    place: StagedStore
    sources: Sequence[SourceStore]
    plan: RowPlan
    seeds: tuple[SeedSource, ...]
    repeats: tuple[RowPlan, RowPlan]
    """(K,) each: rows that are left out, and the rows that replace them."""
    is_plain: bool
    """Whether row i is episode i of one seed."""
    warnings: tuple[str, ...] = ()

    @property
    def base(self) -> SourceStore:
        """The store whose config and root attributes become those of the result.

        It is the first one that may hold real episodes, or the first of all.
        """
        return base_of(self.sources)


def base_of(sources: Sequence[SourceStore]) -> SourceStore:
    """Return the store that a result is made like; see ``Order.base``."""
    real = (source for source in sources if source.config.capture is not None)
    return next(real, sources[0])


def build(
    order: Order,
    on_start: Callable[[int], None],
    on_row: Callable[[], None],
) -> Collected:
    """Write the store and return what it contains.

    Args:
        order: the store to build.
        on_start: called once with the number of rows to copy, after every check.
        on_row: called for each row that has been written and read back.

    Raises:
        StoreError: if a row is damaged in its store or differs when it is read back, or the disk
            fails. Nothing is left then.
        UsageError: if the store cannot be written at its path.
    """
    first, plan = order.base, order.plan
    labels, left_out = carried_labels(order.sources, plan)
    check_annotations(order.sources)
    carried = {name: carried_data(order.sources, name) for name in embedded_in(first.config)}
    statuses = _statuses(order)
    with order.place.building() as aside:
        create_store(
            aside,
            first.config,
            _attributes(order),
            joints=first.reader.joints,
            n=len(plan.store),
            carried=carried,
            fields=_fields(first),
        )
        on_start(int(np.sum(statuses > 0)))
        _copy(order, aside, on_row)
        if not np.array_equal(Columns.open(aside).read("status")["status"], statuses):
            raise _not_as_written(order.place.path, "its rows are not all there")
        for label in labels:
            label.write(aside)
        annotated = carry_annotations(order.sources, plan, order.repeats, aside)
        pack(aside)
    missing, committed, quarantined = np.bincount(statuses, minlength=3).tolist()
    return Collected(
        path=str(order.place.path),
        rows=len(plan.store),
        committed=committed,
        quarantined=quarantined,
        missing=missing,
        can_grow=order.is_plain,
        repeated=len(order.repeats[0]),
        sources=order.seeds,
        labels=tuple(label.name for label in labels),
        labels_left_out=left_out,
        annotations=annotated,
        warnings=order.warnings,
    )


def _attributes(order: Order) -> dict[str, Any]:
    attributes = {k: v for k, v in order.base.attributes.items() if k != SOURCES}
    if order.is_plain:
        return attributes
    return attributes | {SOURCES: to_plain(order.seeds)}


def _fields(source: SourceStore) -> list[schema.Field]:
    """Return the fields of a source, and the column of fingerprints, which an old one lacks."""
    known = {*source.reader.fields, schema.FINGERPRINT.path}
    return [field for field in schema.expand(source.config) if field.path in known]


def _statuses(order: Order) -> NDArray[np.uint8]:
    statuses = np.zeros(len(order.plan.store), np.uint8)
    for k, source in enumerate(order.sources):
        mine = order.plan.store == k
        statuses[mine] = source.status[order.plan.row[mine]]
    return statuses


def carried_data(sources: Sequence[SourceStore], name: str) -> bytes:
    """Return the embedded data at a path, from the first store with an undamaged copy."""
    for source in sources:
        try:
            array = open_embedded(open_store(source.path, mode="r")[0], name)
            content = read_array(array)
        except LimitError:
            raise
        except StoreError:
            continue
        if array.attrs.get(VALUES_SEAL) == values_digest(content):
            return content.tobytes()
    where = sources[0].path / name
    raise StoreError(f"{where} is damaged; {mending(sources[0].path)}")


def _copy(order: Order, aside: Path, on_row: Callable[[], None]) -> None:
    """Copy block by block; read back what was written, and compare."""
    writer, reader = ZarrWriter(aside), RowReader(aside)
    for block in range(-(-writer.length // writer.block_size)):
        start = block * writer.block_size
        plan = order.plan[start : start + writer.block_size]
        wanted = _copy_block(order, plan, block, writer)
        stop = start + len(wanted)
        try:
            found = [_known(row) for row in reader.read(start, stop)]
        except StoreError:
            found = []
        if found != wanted:
            raise _not_as_written(order.place.path, f"rows {start} to {stop - 1} are others")
        for _ in wanted:
            on_row()


def _copy_block(
    order: Order, plan: RowPlan, block: int, writer: ZarrWriter
) -> list[tuple[str, str]]:
    """Write a block; return only checksum and fingerprint of each row, to save memory."""
    rows = list(_rows(order, plan))
    if rows:
        texts = [row.fingerprint for row in rows]
        writer.write_block(block, [row.content for row in rows], texts)
    return [_known(row) for row in rows]


def _known(row: StoredRow) -> tuple[str, str]:
    """Return checksum and fingerprint of a row."""
    return row.checksum, row.fingerprint


def _rows(order: Order, plan: RowPlan) -> Iterator[StoredRow]:
    there = plan[plan.store != NOBODY]
    recipes = zip(there.seed.tolist(), there.index.tolist(), strict=True)
    for k, first, stop in plan.runs():
        source = order.sources[k]
        for i, row in enumerate(source.reader.read(first, stop), first):
            spec, recipe = row.content.spec, next(recipes)
            if (spec.seed, spec.index) != recipe:
                raise StoreError(
                    f"{source.path}: row {i} holds episode {spec.index} of seed {spec.seed}, not"
                    f" {recipe[1]} of {recipe[0]}; {mending(source.path)}"
                )
            yield _fitting(row, order.base.config)


def _fitting(row: StoredRow, config: FactoryConfig) -> StoredRow:
    """Return a row with the arrays of the result: a simulated one has no real samples."""
    if not isinstance(row.content, Episode):
        return row
    content = with_room_for_real(row.content, config)
    if content is row.content:
        return row
    return replace(row, content=content, checksum=checksum(content.contents()))


def _not_as_written(path: Path, what: str) -> StoreError:
    return StoreError(
        f"{path}: read back after writing, {what}; disk or memory may be failing, nothing is kept"
    )
