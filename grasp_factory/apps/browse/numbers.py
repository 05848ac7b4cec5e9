"""Numbers for JSON: rounded, and null for NaN and infinity."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

DIGITS = 6
"""Significant digits of curves and poses: float32 has seven."""


def rounded(values: ArrayLike) -> list[Any]:
    """Return an array as nested lists of numbers with six significant digits, None for NaN."""
    array = np.asarray(values, np.float64)
    out = array.copy()
    counts = np.isfinite(array) & (array != 0.0)
    whole = array[counts]
    # The bound keeps the scale finite: smaller values become 0.
    scale = 10.0 ** np.minimum(DIGITS - 1 - np.floor(np.log10(np.abs(whole))), 300.0)
    out[counts] = np.rint(whole * scale) / scale
    finite = np.isfinite(out)
    if finite.all():
        return list(out.tolist())
    with_gaps = out.astype(object)
    with_gaps[~finite] = None
    return list(with_gaps.tolist())


def plain(value: Any) -> Any:
    """Return a value for JSON: numpy's values as Python's, None for NaN and infinity."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def json_bytes(value: Any) -> bytes:
    """Return strict JSON, ASCII only."""
    return json.dumps(plain(value), separators=(",", ":"), allow_nan=False).encode("ascii")
