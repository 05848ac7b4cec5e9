"""Parquet files of numpy arrays and plain rows. Nothing else of this format imports pyarrow."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

_COMPRESSION = "zstd"
_INDEX = "__index_level_0__"
"""Name of the column with an index that has no name, in tables of pandas."""
IMAGE_TYPE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])
"""How ``datasets.Image`` stores an image: https://huggingface.co/docs/datasets/image_load"""


@contextlib.contextmanager
def parquet_file(path: Path) -> Iterator[Callable[[Mapping[str, pa.Array]], None]]:
    """Yield a function that appends columns to a new file as a row group.

    Raises:
        OSError: if it cannot be written.
    """
    with path.open("wb") as file, contextlib.ExitStack() as stack:
        writers: list[pq.ParquetWriter] = []

        def append(columns: Mapping[str, pa.Array]) -> None:
            table = pa.table(dict(columns))
            if not writers:
                writer = pq.ParquetWriter(file, table.schema, compression=_COMPRESSION)
                writers.append(stack.enter_context(writer))
            writers[0].write_table(table)

        yield append


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of plain data, all with the same keys, to a new file.

    Raises:
        OSError: if it cannot be written.
    """
    write_table(path, pa.Table.from_pylist(list(rows)))


def write_tasks(path: Path, tasks: Sequence[str]) -> None:
    """Write LeRobot's table of tasks: a table of pandas whose index is the text.

    ``load_tasks`` reads it with pandas, which finds the index in the metadata:
    https://pandas.pydata.org/docs/development/developer.html

    Raises:
        OSError: if it cannot be written.
    """
    number = {"pandas_type": "int64", "numpy_type": "int64", "metadata": None}
    text = {"pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    pandas = {
        "index_columns": [_INDEX],
        "column_indexes": [],
        "columns": [
            {"name": "task_index", "field_name": "task_index", **number},
            {"name": None, "field_name": _INDEX, **text},
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), _INDEX: list(tasks)})
    write_table(path, table.replace_schema_metadata({"pandas": json.dumps(pandas)}))


def write_table(path: Path, table: pa.Table) -> None:
    """Write a table to a new file.

    Raises:
        OSError: if it cannot be written.
    """
    with path.open("wb") as file:
        pq.write_table(table, file, compression=_COMPRESSION)


def write_columns(
    path: Path, numbers: Mapping[str, NDArray[Any]], arrays: Mapping[str, Sequence[NDArray[Any]]]
) -> None:
    """Write a new file of rows that have numbers, and arrays whose first length may differ.

    Raises:
        OSError: if it cannot be written.
    """
    columns = {name: array_column(values) for name, values in numbers.items()}
    columns |= {name: series_column(rows) for name, rows in arrays.items()}
    write_table(path, pa.table(columns))


def series_column(rows: Sequence[NDArray[Any]]) -> pa.Array:
    """Return arrays (length, *shape), whose lengths may differ, as a column of lists."""
    one = value_type(rows[0].dtype, rows[0].shape[1:])
    return pa.array([row.tolist() for row in rows], pa.list_(one))


def value_type(dtype: np.dtype[Any], shape: Sequence[int]) -> pa.DataType:
    """Return the type that LeRobot stores values of a shape as; a number for ``()``.

    It is that of ``datasets``: a list of a fixed length for a vector, lists of lists for more
    dimensions. https://huggingface.co/docs/datasets/about_dataset_features
    """
    number = pa.from_numpy_dtype(dtype)
    if len(shape) == 1:
        return pa.list_(number, shape[0])
    for _ in shape:
        number = pa.list_(number)
    return number


def array_column(values: NDArray[Any]) -> pa.Array:
    """Return the rows of an array (rows, *shape) as a column of ``value_type``."""
    flat = pa.array(values.reshape(-1))
    if values.ndim == 2:
        return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    for axis in range(values.ndim - 1, 0, -1):
        length = values.shape[axis]
        count = int(np.prod(values.shape[:axis]))
        flat = pa.ListArray.from_arrays(np.arange(count + 1, dtype=np.int32) * length, flat)
    return flat


def image_column(images: Sequence[bytes]) -> pa.Array:
    """Return encoded images as a column of ``IMAGE_TYPE``."""
    return pa.array([{"bytes": image, "path": None} for image in images], IMAGE_TYPE)
