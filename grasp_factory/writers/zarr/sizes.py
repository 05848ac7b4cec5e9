"""Compute the size of a store without examining each of its files."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.object_storage.address import is_remote
from grasp_factory.core.place import Place
from grasp_factory.core.place_tree import file_facts_below, files_below
from grasp_factory.writers.zarr.column_segments import apart, segments
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.layout import block_files, block_number


def store_bytes(columns: Columns) -> int:
    """Return the bytes of a store: its committed blocks, its metadata and all other files.

    A packed segment records the bytes of its blocks. Blocks of killed runs are not counted.
    """
    if is_remote(columns.path):
        return _bytes_by_listing(columns)
    loose, total = columns.blocks(), 0
    for segment in apart(segments(columns.place)):
        size = segment.block_bytes() if segment.is_in(loose) else None
        if size is not None:
            loose[segment.place] = False
            total += size
    paths = {row.path for row in schema.expand(columns.config)}
    metadata = sum(_size(columns.place / path / "zarr.json") for path in paths)
    beside = sum(map(_size, files_below(columns.place, without=paths)))
    return total + bytes_of_blocks(columns, np.flatnonzero(loose).tolist()) + metadata + beside


def bytes_of_blocks(columns: Columns, blocks: Iterable[int]) -> int:
    """Return the bytes of all files of some blocks, of every array."""
    fields, total = schema.expand(columns.config), 0
    for block in blocks:
        rows = range(*columns.rows(block))
        for row in fields:
            total += sum(map(_size, block_files(columns.place, row, block, rows)))
    return total


def _bytes_by_listing(columns: Columns) -> int:
    """Return ``store_bytes`` of a store in object storage, by one listing."""
    markers = np.flatnonzero(columns.blocks())
    fields, total = {row.path: row for row in schema.expand(columns.config)}, 0
    there, size = set(markers.tolist()), columns.config.block_size
    for file, facts in file_facts_below(columns.place):
        row = fields.get(file.parent.inner)
        number = block_number(file.name, row) if row else None
        if number is None or (number // size if row and row.is_video else number) in there:
            total += facts.st_size
    return total


def _size(file: Place) -> int:
    try:
        return file.stat().st_size
    except (FileNotFoundError, NotADirectoryError):
        return 0
