"""A large store of few episodes: the files of a store, linked under more numbers."""

from __future__ import annotations

import json
import os
from pathlib import Path

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.row_reader import RowReader
from grasp_factory.writers.zarr.store import prepare_store


def repeat(source: Path, out: Path, rows: int) -> None:
    """Make a store in which the whole blocks of another one repeat.

    It takes hardly any disk. Readers that check a store refuse it: it has each episode several
    times.

    Args:
        source: a store with at least one whole block, all of whose rows are there.
        out: the store to make.
        rows: its number of rows, a multiple of the block size.
    """
    config = Dataset(source).config
    joints = RowReader(source).joints
    whole = len(Dataset(source)) // config.block_size * config.block_size
    prepare_store(out, config, joints, rows, {})
    for metadata in out.rglob("zarr.json"):
        about = json.loads(metadata.read_bytes())
        if about["node_type"] == "array":
            size = about["chunk_grid"]["configuration"]["chunk_shape"][0]
            link(
                source / metadata.parent.relative_to(out),
                metadata.parent,
                whole // size,
                rows // size,
            )


def link(source: Path, out: Path, there: int, wanted: int) -> None:
    """Link the files of an array: number k to number k modulo those that are there."""
    files = {int(file.name.partition(".")[0]): file for file in source.glob("[0-9]*")}
    for number in range(wanted):
        if file := files.get(number % there):
            _, dot, tail = file.name.partition(".")
            os.link(file, out / f"{number}{dot}{tail}")
