"""Compute the size of a store without examining each of its files."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from grasp_factory.core import schema
from grasp_factory.writers.zarr.column_segments import BYTES, segments
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.layout import block_files


def store_bytes(columns: Columns) -> int:
    """Return the bytes of a store: its committed blocks, its metadata and all other files.

    A packed segment records the bytes of its blocks. Blocks of killed runs are not counted.
    """
    loose, total = columns.blocks(), 0
    for segment in segments(columns.path):
        packed = segment.read([BYTES])
        if packed and segment.is_in(loose):
            loose[segment.place] = False
            total += int(packed[BYTES])
    paths = {row.path for row in schema.expand(columns.config)}
    arrays = {str(columns.path / path) for path in paths}
    metadata = sum(_size(Path(array) / "zarr.json") for array in arrays)
    beside = _other_bytes(columns.path, arrays)
    return total + bytes_of_blocks(columns, np.flatnonzero(loose).tolist()) + metadata + beside


def bytes_of_blocks(columns: Columns, blocks: Iterable[int]) -> int:
    """Return the bytes of all files of some blocks, of every array."""
    fields, total = schema.expand(columns.config), 0
    for block in blocks:
        rows = range(*columns.rows(block))
        for row in fields:
            total += sum(map(_size, block_files(columns.path, row, block, rows)))
    return total


def _other_bytes(folder: Path, arrays: set[str]) -> int:
    """Return the bytes of all files below a folder that are not in one of these arrays."""
    total = 0
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                total += 0 if entry.path in arrays else _other_bytes(Path(entry.path), arrays)
            else:
                total += entry.stat().st_size
    return total


def _size(file: Path) -> int:
    try:
        return os.stat(file).st_size
    except (FileNotFoundError, NotADirectoryError):
        return 0
