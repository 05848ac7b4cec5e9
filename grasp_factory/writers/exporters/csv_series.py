"""Time series as CSV files, exact: each number is the shortest text that yields it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.errors import shown


def write_series(path: Path, series: Mapping[str, NDArray[Any]]) -> None:
    """Write time series that share a clock; the header names the columns, and NaN is empty.

    Args:
        path: the file.
        series: by the names of its columns, separated by commas, each (K,) or (K, columns).

    Raises:
        OSError: if it cannot be written.
    """
    columns = [_texts(c) for values in series.values() for c in np.atleast_2d(values.T)]
    lines = [",".join(series), *map(",".join, zip(*columns, strict=True))]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def read_series(data: bytes, series: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Return time series of a CSV file that ``write_series`` wrote, each (K, columns).

    Args:
        data: the file's bytes.
        series: the names of the columns of each time series, in the file's order.

    Raises:
        ValueError: if it is another table.
    """
    head, *lines = data.decode("ascii").splitlines() or [""]
    if head != ",".join(series):
        raise ValueError(f"got the columns {shown(head)}, valid: {shown(','.join(series))}")
    width = head.count(",") + 1
    rows = [[float(cell or "nan") for cell in line.split(",")] for line in lines]
    if any(len(row) != width for row in rows):
        raise ValueError(f"a line has not {width} cells")
    table = np.array(rows, np.float64).reshape(len(rows), width)
    ends = np.cumsum([names.count(",") + 1 for names in series])
    return dict(zip(series, np.split(table, ends[:-1], axis=1), strict=True))


def numbered(name: str, count: int) -> str:
    """Return the names of ``count`` columns, ``name_0,name_1,...``."""
    return ",".join(f"{name}_{k}" for k in range(count))


def _texts(values: NDArray[Any]) -> list[str]:
    return ["" if text == "nan" else text for text in values.astype(np.str_).tolist()]
