"""Conditions on a column: which rows hold a value, or one of several."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.errors import UsageError, lookup, shown
from grasp_factory.schema import Field

_KINDS = {"string": "UT", "bool": "b"}
"""numpy's kinds of values that a column of a type may be compared with; numbers otherwise."""


def matching(row: Field, values: NDArray[Any], wanted: Any) -> NDArray[np.bool_]:
    """Return which values of a column, (N,), equal ``wanted``, or one of its items.

    Raises:
        UnknownNameError: for a word that a coded column does not know.
        UsageError: for a value of another type than the column's, or a column with more than one
            value per row.
    """
    name = row.path.removeprefix("episodes/")
    if values.ndim > 1:
        raise UsageError(f"where: {name} has {values.shape[1:]} values a row, valid: one")
    several = isinstance(wanted, Iterable) and not isinstance(wanted, str)
    found = [values == _stored(row, name, item) for item in (wanted if several else [wanted])]
    keep = np.zeros(len(values), np.bool_)
    for rows in found:
        keep |= rows
    return keep


def _stored(row: Field, name: str, value: Any) -> Any:
    """Return what a column holds for ``value``: for a word of a coded column, its code."""
    if row.names and isinstance(value, str):
        return lookup({word: code for code, word in enumerate(row.names)}, name, value)
    if np.asarray(value).dtype.kind not in _KINDS.get(row.dtype, "iuf"):
        raise UsageError(f"where: {name}: got {shown(value)}, valid: {row.dtype}")
    return value
