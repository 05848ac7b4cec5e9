"""The number of rows of a store, even where its metadata is damaged or wrong."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from statistics import median_low
from typing import Any

import numpy as np

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import Place
from grasp_factory.core.schema import Field
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.budgets import check_row_count
from grasp_factory.writers.zarr.chunks import unpack, unpack_words
from grasp_factory.writers.zarr.layout import block_files, block_number

_OF_EVERY_ROW = (
    *(schema.STATUS.path, schema.CHECKSUM.path),
    *("episodes/spec", "episodes/seed", "episodes/index"),
)
"""Columns whose value differs from their fill value in each row that was made."""


def document_rows(document: Any) -> int | None:
    """Return the number of rows in an array's ``zarr.json``; None if it is invalid.

    The metadata's checksum does not cover it.
    """
    shape = document.get("shape") if isinstance(document, dict) else None
    rows: Any = shape[0] if isinstance(shape, list) and shape else None
    return rows if is_integer(rows) and rows >= 0 else None


def most_rows(documents: Iterable[Any]) -> int | None:
    """Return the number of rows that most arrays have, by their ``zarr.json``; None without any."""
    counts = Counter(rows for rows in map(document_rows, documents) if rows is not None)
    return counts.most_common(1)[0][0] if counts else None


def number_of_rows(
    store: Place, config: FactoryConfig, fields: Mapping[str, Field], told: int | None
) -> int:
    """Return the number of rows of a store: never fewer than its files hold.

    A block exists if most arrays have a file of it.

    Args:
        store: the store's directory.
        config: the config that it was made from.
        fields: the store's fields, by path.
        told: the number in its metadata; None if that is lost.

    Raises:
        StoreError: if it cannot be determined.
        LimitError: if a file's name claims many more rows than there are files for.
    """
    of_blocks = [field for field in fields.values() if not field.is_video]
    files = Counter(block for field in of_blocks for block in _block_numbers(store, field))
    believed = [block for block, count in files.items() if 2 * count > len(of_blocks)]
    if told is None and not believed:
        what = "no array's zarr.json tells the number of rows, and there are no files of blocks"
        raise StoreError(f"{store}: {what}: make the store again with its generate command")
    if not believed:
        return told or 0
    start = max(believed) * config.block_size
    check_row_count(start, len(files), config.block_size, store)
    names = [name for name in _OF_EVERY_ROW if name in fields]
    filled = [_filled(store, fields[name], max(believed), config) for name in names]
    counts = [count for count in filled if count]
    if counts:
        return max(told or 0, start + median_low(counts))  # one of them may be another block's
    if told is None or told <= start:
        what = f"its last block, {max(believed)}, is damaged, so the number of rows cannot be told"
        advice = "copy a zarr.json of any array from a store of the same command, and repair again"
        raise StoreError(f"{store}: {what}: {advice}")
    return told


def _block_numbers(store: Place, field: Field) -> Iterator[int]:
    """Yield the numbers of the blocks of which a field has a file."""
    folder = store / field.path
    for name in folder.names() if folder.is_dir() else ():
        number = block_number(name, field)
        if number is not None:
            yield number


def _filled(store: Place, field: Field, block: int, config: FactoryConfig) -> int | None:
    """Return how many rows of a block a column fills; None if it cannot be read."""
    size = config.block_size
    file = block_files(store, field, block, range(0))[0]
    if not file.is_file():
        return None
    try:
        if field.dtype == "string":
            there = unpack_words(file.read_bytes(CHUNK), (size,)) != ""
        else:
            values = np.empty(size, field.dtype)
            unpack(file.read_bytes(CHUNK), values)
            there = values != field.fill
    except Exception:  # decoders raise many types for damaged bytes
        return None
    return int(np.flatnonzero(there)[-1]) + 1 if there.any() else 0
