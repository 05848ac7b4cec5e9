"""Time series as CSV files, exact: each number is the shortest text that yields it again."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


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


def numbered(name: str, count: int) -> str:
    """Return the names of ``count`` columns, ``name_0,name_1,...``."""
    return ",".join(f"{name}_{k}" for k in range(count))


def _texts(values: NDArray[Any]) -> list[str]:
    return ["" if text == "nan" else text for text in values.astype(np.str_).tolist()]
