"""Packing a store: the same rows, in larger blocks, at another place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.place_tree import fsync_tree
from grasp_factory.core.serialization import to_plain
from grasp_factory.curation.merge.annotation_transfer import check_annotations
from grasp_factory.curation.merge.building import carried_data
from grasp_factory.curation.merge.label_transfer import carried_labels
from grasp_factory.curation.merge.provenance import stored_sources
from grasp_factory.curation.merge.staged_store import StagedStore
from grasp_factory.curation.merge.union import RowPlan
from grasp_factory.curation.pack.block_joining import BlockJoiner
from grasp_factory.curation.pack.source_layout import PackSource, is_same_content
from grasp_factory.curation.versions.origin import states_of, write_origin
from grasp_factory.dataset.annotations import carry
from grasp_factory.dataset.annotations.log_file import FOLDER as ANNOTATIONS
from grasp_factory.errors import StoreError, StoreMismatchError, UsageError
from grasp_factory.writers.zarr.budgets import check_block_size
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.embedded import embedded_in
from grasp_factory.writers.zarr.header import SOURCES, read_attributes
from grasp_factory.writers.zarr.label_columns import LABELS
from grasp_factory.writers.zarr.metadata_checksum import SEAL
from grasp_factory.writers.zarr.segment_packing import pack
from grasp_factory.writers.zarr.store import create_store

_SUFFIX = ".packing"


@dataclass(frozen=True, slots=True, kw_only=True)
class Packed:
    """A packed store."""

    path: str
    rows: int
    block_size: int
    blocks: int
    resumed: int
    """Blocks that a run before this one had finished."""
    labels: tuple[str, ...]
    """Added labels that were copied."""


def pack_store(
    store: Path | str,
    out: Path | str,
    block_size: int,
    *,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[], None] = lambda: None,
) -> Packed:
    """Copy a store to a new one with larger blocks.

    The files have the bytes of a store that was made with that block size. Images and series are
    not decompressed, and so not compared with their checksums; ``verify`` does that. A run that
    ends early leaves the blocks that it has finished in a folder beside the new store, and the same
    call goes on with them.

    Args:
        store: path of the store, which stays as it is; no row may be missing.
        out: a path where nothing exists yet, or an empty directory.
        block_size: rows of the new blocks: a multiple of those of the store, up to 1,024.
        on_start: called with the number of rows, after every check.
        on_row: called for each row when its block is written.

    Raises:
        UsageError: for a store that cannot be packed, a block size, or an output path that is
            taken.
        StoreError: if the store is damaged, or the disk fails.
    """
    source = PackSource(store_path(store))
    source.check_rows(None)
    return _pack(source, out, block_size, on_start, on_row)


def pack_part(store: Path, out: Path, block_size: int) -> Packed:
    """Copy a store of which others make a part, as ``pack_store`` does.

    Of the rows of a new block all or none may be missing; the block is then missing, too.
    """
    source = PackSource(store)
    source.check_rows(block_size)
    return _pack(source, out, block_size, lambda rows: None, lambda: None)


def _pack(
    source: PackSource,
    out: Path | str,
    block_size: int,
    on_start: Callable[[int], None],
    on_row: Callable[[], None],
) -> Packed:
    place = StagedStore(out, _SUFFIX)
    place.check_apart([source.store.place])
    config = _config(source, block_size)
    check_annotations([source.store])
    plan = _plan(source)
    labels, _ = carried_labels([source.store], plan)
    blocks = -(-source.length // block_size)
    states, resumed = states_of([source.store.path]), 0
    with place.resuming() as aside:
        _prepare(source, aside, config)
        finished = _finished(source, aside, block_size)
        joiner = BlockJoiner(source, place_of(aside), config)
        on_start(source.length)
        for block in range(blocks):
            if finished[block]:
                resumed += 1
            else:
                joiner.join(block)
            for _ in joiner.rows(block):
                on_row()
        if not source.is_as_opened():
            raise StoreError(f"{source.store.path} has changed meanwhile: run the command again")
        if not is_same_content(aside, source.store.status, source.checksums):
            raise StoreError(f"{out}: read back after writing, rows differ; nothing is published")
        _add_beside_rows(source, aside, plan, labels)
    write_origin(out, "pack", states)
    return Packed(
        path=str(out),
        rows=source.length,
        block_size=block_size,
        blocks=blocks,
        resumed=resumed,
        labels=tuple(label.name for label in labels),
    )


def _config(source: PackSource, block_size: int) -> FactoryConfig:
    each, path = source.config.block_size, source.store.path
    if block_size <= each or block_size % each:
        raise UsageError(
            f"--shard {block_size}: {path} has blocks of {each}, valid: a larger multiple of {each}"
        )
    config = replace(source.config, block_size=block_size)
    check_block_size(config)
    return config


def _plan(source: PackSource) -> RowPlan:
    """Return the plan by which every row keeps its number."""
    rows = source.store.present()
    return RowPlan(
        store=np.zeros(source.length, np.int64), row=rows.row, seed=rows.seed, index=rows.index
    )


def _prepare(source: PackSource, aside: Path, config: FactoryConfig) -> None:
    """Create the store, unless it is there; remove one that another command has begun."""
    attributes, folder = _attributes(source, config), place_of(aside)
    if not _is_begun(source, aside, attributes):
        for name in folder.names():
            _remove(folder / name)
        create_store(
            aside,
            config,
            attributes,
            joints=source.store.reader.joints,
            n=source.length,
            carried={name: carried_data([source.store], name) for name in embedded_in(config)},
            fields=list(source.fields.values()),
        )
    for name in (LABELS, ANNOTATIONS):  # they may have changed since
        if (folder / name).exists():
            (folder / name).rmtree()


def _attributes(source: PackSource, config: FactoryConfig) -> dict[str, Any]:
    attributes = source.packed_attributes(config)
    if SOURCES in attributes:
        own = (replace(config, seed=item.seed).sha256() for item in stored_sources(attributes))
        pairs = zip(stored_sources(attributes), own, strict=True)
        attributes[SOURCES] = to_plain([replace(s, config_sha256=name) for s, name in pairs])
    return attributes


def _is_begun(source: PackSource, aside: Path, attributes: dict[str, Any]) -> bool:
    try:
        found = read_attributes(aside)
        length = Columns.open(aside).length
    except (StoreError, StoreMismatchError):
        return False
    known = {key: value for key, value in found.items() if key != SEAL}
    return known == attributes and length == source.length


def _finished(source: PackSource, aside: Path, block_size: int) -> list[bool]:
    """Return for each new block whether it is committed, and has the source's rows."""
    found = Columns.open(aside).read("status", "checksum")
    same = found["status"] == source.store.status
    pairs = zip(found["checksum"].tolist(), source.checksums.tolist(), strict=True)
    same &= np.array([mine == other for mine, other in pairs], np.bool_)
    starts = range(0, source.length, block_size)
    return [bool(same[start : start + block_size].all()) for start in starts]


def _add_beside_rows(source: PackSource, aside: Path, plan: RowPlan, labels: Any) -> None:
    """Copy labels and annotations, and pack columns, as a run does."""
    for label in labels:
        label.write(aside)
    carry(source.store.path, aside, {row: row for row in range(len(plan))})
    pack(aside)
    for name in (LABELS, ANNOTATIONS):
        if (place_of(aside) / name).exists():
            fsync_tree(place_of(aside) / name)


def _remove(place: Place) -> None:
    if place.is_dir():
        place.rmtree()
    else:
        place.unlink()
