"""Conditions on a column: a value, one of several values, or a range of numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.schema import Field
from grasp_factory.core.serialization import is_integer, is_number
from grasp_factory.core.splits import SPLITS
from grasp_factory.errors import UsageError, lookup, shown, unknown_value

_KINDS = {"string": "UT", "bool": "b"}
"""numpy's kinds of values that a column may be compared with, by the column's type.

Columns of all other types may be compared with numbers."""


@dataclass(frozen=True, slots=True)
class Range:
    """The numbers x with ``at_least`` <= x < ``below``; NaN is in no range.

    Adjacent ranges, such as ``Range(0.0, 0.1)`` and ``Range(0.1, 0.2)``, share no number.
    """

    at_least: float | None = None
    """None for no bound."""
    below: float | None = None
    """None for no bound."""

    def __post_init__(self) -> None:
        """Check that there is a bound, and that the range is not empty.

        Raises:
            UsageError: naming the bounds.
        """
        bounds = [bound for bound in (self.at_least, self.below) if bound is not None]
        if not bounds or not all(map(_is_finite, bounds)) or sorted(set(bounds)) != bounds:
            got = f"at_least {shown(self.at_least)}, below {shown(self.below)}"
            valid = "two finite numbers, the first the smaller one, or one of them and None"
            raise UsageError(f"Range: got {got}, valid: {valid}")

    def holds(self, values: NDArray[Any]) -> NDArray[np.bool_]:
        """Return, for each number of an array of any shape, whether it is in the range."""
        held = np.ones(values.shape, np.bool_)
        if self.at_least is not None:
            held &= values >= self.at_least
        if self.below is not None:
            held &= values < self.below
        return held


def matching(
    row: Field, values: NDArray[Any], wanted: Any, known: Callable[[], Iterable[str]]
) -> NDArray[np.bool_]:
    """Return, for each value of a column, (N,), whether it is ``wanted`` or one of its items.

    Args:
        row: The field of the column.
        values: The values of the column, (N,).
        wanted: A value, a ``Range``, or several of them.
        known: Returns the texts that the column has in the whole store; it is called only for a
            text that ``values`` lack.

    Raises:
        UnknownNameError: for a name that a column of coded values does not have, or a text that
            a column of texts does not have.
        UsageError: for a value of another type than the column's, a range for a column that is
            not numeric, or a column with more than one value per row.
    """
    name = row.path.removeprefix("episodes/")
    if values.ndim > 1:
        raise UsageError(f"where: {name} has {values.shape[1:]} values a row, valid: one")
    is_numeric = not row.names and row.dtype not in _KINDS
    if is_numeric and isinstance(wanted, tuple):
        low, high = (*map(shown, wanted), "None", "None")[:2]
        valid = f"Range({low}, {high}) for numbers between, [{low}, {high}] for one of them"
        raise UsageError(f"where: {name}: got {shown(wanted)}, valid: {valid}")
    several = isinstance(wanted, Iterable) and not isinstance(wanted, str)
    keep = np.zeros(len(values), np.bool_)
    for item in wanted if several else [wanted]:
        held = _equal(row, name, values, item)
        if row.dtype == "string" and item and not held.any():
            _check_known(name, str(item), known())
        keep |= held
    return keep


def _check_known(column: str, text: str, known: Iterable[str]) -> None:
    """Check that a row of the store has a text; a store without any text has no wrong ones.

    Raises:
        UnknownNameError: naming the nearest and the valid texts.
    """
    there = {*known} - {""}
    if column == "split":
        there |= {*SPLITS}
    if there and text not in there:
        raise unknown_value(column, text, there)


def _equal(row: Field, name: str, values: NDArray[Any], item: Any) -> Any:
    """Return, for each value, whether it equals ``item`` or is in this range."""
    if not isinstance(item, Range):
        return values == _stored(row, name, item)
    if row.names or row.dtype in _KINDS:
        valid = f"words, of {', '.join(row.names)}" if row.names else row.dtype
        raise UsageError(f"where: {name}: got {shown(item)}, valid: {valid}")
    return item.holds(values)


def _stored(row: Field, name: str, value: Any) -> Any:
    """Return ``value`` as the column stores it: a code for a name of coded values."""
    if row.names and isinstance(value, str):
        return lookup({word: code for code, word in enumerate(row.names)}, name, value)
    if row.names and is_integer(value) and not 0 <= value < len(row.names):
        valid = f"a code from 0 to {len(row.names) - 1}, or its word: {', '.join(row.names)}"
        raise UsageError(f"where: {name}: got {shown(value)}, valid: {valid}")
    if np.asarray(value).dtype.kind not in _KINDS.get(row.dtype, "iuf"):
        more = "" if row.names or row.dtype in _KINDS else ", or Range(at_least, below)"
        raise UsageError(f"where: {name}: got {shown(value)}, valid: {row.dtype}{more}")
    return value


def _is_finite(bound: Any) -> bool:
    try:
        return is_number(bound) and math.isfinite(bound)
    except OverflowError:  # an integer beyond the range of floats
        return False
