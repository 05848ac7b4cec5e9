"""Queries of an index: conditions on columns, and an order."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from grasp_factory.dataset.index.columns import BY_NAME, IndexColumn
from grasp_factory.errors import UsageError, lookup, shown

SYNTAX = (
    "COLUMN=VALUE, COLUMN!=VALUE, COLUMN<VALUE, <=, >, >=, COLUMN~TEXT (contains),"
    " COLUMN=[A,B] (any of), COLUMN=null, COLUMN!=null"
)
MAX_CONDITIONS = 50
MAX_VALUES = 500
"""Maximum number of values in a list."""
MAX_ALL_VALUES = 5000
"""Maximum number of values in all conditions together."""
LONGEST = 4_000
"""Maximum number of characters of a value: as of a note, and within the limit of LIKE."""
_EQUAL, _ORDER = ("=", "!="), ("<", "<=", ">", ">=")
OPERATORS: Mapping[str, tuple[str, ...]] = {
    "word": (*_EQUAL, "~"),
    "text": (*_EQUAL, "~"),
    "number": (*_EQUAL, *_ORDER),
    "whole": (*_EQUAL, *_ORDER),
    "bool": _EQUAL,
    "json": ("~",),
    "time": (*_EQUAL, *_ORDER),
    "tags": (*_EQUAL, "~"),
}
"""The operators that a column takes, by its kind."""
_CONDITION = re.compile(r"\s*([A-Za-z_]\w*)\s*(!=|<=|>=|=|<|>|~)(.*)", re.DOTALL)
_TIME = re.compile(r"\d{4}(-\d\d(-\d\d([T ]\d\d(:\d\d(:\d\d(Z|\+00:00)?)?)?)?)?)?", re.ASCII)
_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_RANGE = re.compile(r"[\[(]?\s*([-+.0-9eE]+?)\s*(?:,|:|\.\.)\s*([-+.0-9eE]+)\s*[\])]?")
"""What users write for a range of numbers."""
_WHOLE = re.compile(r"[-+]?[0-9]{1,18}")
_BOOLS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}

Value = str | float | bool | None
"""None is null: the row has no value."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A comparison of a column with values.

    ``!=`` is the opposite of ``=``, so rows without a value fulfil it.
    """

    column: str
    operator: str
    values: tuple[Value, ...]
    """One value; or several, of which a row's value must be any (``=``) or none (``!=``)."""

    def __post_init__(self) -> None:
        """Check the column, the operator and the values.

        Raises:
            UnknownNameError: for an unknown column, or a word that its column cannot have.
            UsageError: for an operator or a value that the column's kind does not take.
        """
        column = lookup(BY_NAME, "column", self.column)
        has_null = None in self.values
        valid = (*OPERATORS[column.kind], *(_EQUAL if has_null else ()))
        if self.operator not in valid:
            got = f"{self.column} is a {column.kind} column: got {self.operator}"
            raise UsageError(f"{got}, valid: {' '.join(OPERATORS[column.kind])}; or =null, !=null")
        if self.operator not in _EQUAL and (has_null or len(self.values) != 1):
            what = f"{self.column}{self.operator}"
            raise UsageError(f"{what}: got {shown(list(self.values))}, valid: one value")
        if not 0 < len(self.values) <= MAX_VALUES:
            got = f"{self.column}: got {len(self.values)} values"
            raise UsageError(f"{got}, valid: 1 to {MAX_VALUES}")
        checked = tuple(_checked(column, self.operator, value) for value in self.values)
        object.__setattr__(self, "values", checked)

    @classmethod
    def parse(cls, text: str) -> Condition:
        """Return the condition that a text such as ``lift_height>=0.1`` describes.

        Raises:
            UsageError: if the text is invalid; the message says what is valid.
        """
        found = _CONDITION.fullmatch(text)
        if not found:
            raise UsageError(f"condition {shown(text)}: valid: {SYNTAX}")
        name, operator, rest = found[1], found[2], found[3].strip()
        column = lookup(BY_NAME, "column", name)
        texts = _items(rest) if operator in _EQUAL else [rest]
        return cls(name, operator, tuple(_read(column, operator, item) for item in texts))


@dataclass(frozen=True, slots=True)
class Sort:
    """An order by one column; rows without a value come last in both directions."""

    column: str
    descending: bool = False

    def __post_init__(self) -> None:
        """Check the column.

        Raises:
            UnknownNameError: for an unknown column.
        """
        lookup(BY_NAME, "column", self.column)


@dataclass(frozen=True, slots=True)
class Query:
    """Which rows of an index to find, and in which order; the default is by store and row."""

    conditions: tuple[Condition, ...] = ()
    """All of them must hold."""
    sort: tuple[Sort, ...] = ()

    def __post_init__(self) -> None:
        """Check how many conditions and values there are.

        Raises:
            UsageError: if there are too many.
        """
        if len(self.conditions) > MAX_CONDITIONS:
            raise UsageError(
                f"got {len(self.conditions)} conditions, valid: up to {MAX_CONDITIONS}"
            )
        values = sum(len(condition.values) for condition in self.conditions)
        if values > MAX_ALL_VALUES:
            raise UsageError(f"got {values} values, valid: up to {MAX_ALL_VALUES} in a query")

    @classmethod
    def parse(cls, where: Sequence[str], sort: str = "") -> Query:
        """Return a query from texts: conditions, ``policy=uniform``; an order, ``-lift_height``.

        Args:
            where: Conditions, all of which must hold.
            sort: Columns, separated by commas; a minus before a column means descending order.

        Raises:
            UsageError: if any text is invalid; the message says what is valid.
        """
        words = [word.strip() for word in sort.split(",")] if sort.strip() else []
        orders = tuple(Sort(word.removeprefix("-"), word.startswith("-")) for word in words)
        if len({order.column for order in orders}) < len(orders):
            raise UsageError(f"sort {shown(sort)}: valid: each column once")
        return cls(tuple(map(Condition.parse, where)), orders)


def _items(text: str) -> list[str | None]:
    """Return the texts of a value: the text itself or the items of a [list]; None for null."""
    if not text.startswith("["):
        return [None if text == "null" else text]
    if not text.endswith("]") or not text[1:-1].strip():
        valid = '[a,b]; a text that begins with a bracket is written ["[a"]'
        raise UsageError(f"list {shown(text)}: valid: {valid}")
    if text[1:].lstrip().startswith('"'):
        try:
            items = json.loads(text)
        except (ValueError, RecursionError):
            items = None
        if not isinstance(items, list) or not all(i is None or isinstance(i, str) for i in items):
            raise UsageError(f'list {shown(text)}: valid: [a,b], or ["a","b"] with quotes in JSON')
        return items
    words = [word.strip() for word in text[1:-1].split(",")]
    return [None if word == "null" else word for word in words]


def _read(column: IndexColumn, operator: str, text: str | None) -> Value:
    """Return a text as a value of a column; the text itself if it cannot be converted."""
    if text is None:
        return None
    if column.kind == "bool":
        return _BOOLS.get(text.lower(), text)
    if column.kind in ("number", "whole"):
        if not _NUMBER.fullmatch(text):
            return text
        return int(text) if _WHOLE.fullmatch(text) else float(text)
    return text


def _checked(column: IndexColumn, operator: str, value: Value) -> Value:
    if value is None:
        return None
    return _CHECKS[column.kind](column, operator, value)


def _word(column: IndexColumn, operator: str, value: Value) -> Value:
    if not isinstance(value, str) or not _is_text(value):
        raise _wrong(column, operator, value, "text")
    if operator == "~" and not value:
        raise _wrong(column, operator, value, "at least a character")
    if column.words and operator != "~":
        lookup(dict.fromkeys(column.words), f"{column.name}", value)
    return value


def _number(column: IndexColumn, operator: str, value: Value) -> Value:
    try:
        good = isinstance(value, int | float) and not isinstance(value, bool)
        good = good and math.isfinite(float(value))  # type: ignore[arg-type]
    except OverflowError:
        good = False
    if not good:
        raise _wrong(column, operator, value, f"a number{_range_hint(column, value)}")
    assert value is not None
    return value if isinstance(value, int) and abs(value) < 2**63 else float(value)


def _range_hint(column: IndexColumn, value: Value) -> str:
    """Return how to ask for a range, if a value looks like one; empty otherwise."""
    found = _RANGE.fullmatch(value) if isinstance(value, str) else None
    if not found:
        return ""
    return f"; for a range two conditions: '{column.name}>={found[1]}' '{column.name}<={found[2]}'"


def _bool(column: IndexColumn, operator: str, value: Value) -> Value:
    if not isinstance(value, bool):
        raise _wrong(column, operator, value, "true or false")
    return value


def _time(column: IndexColumn, operator: str, value: Value) -> Value:
    if not isinstance(value, str) or not _TIME.fullmatch(value) or not _is_on_calendar(value):
        valid = "a date or the beginning of one in UTC, such as 2026-03, 2026-03-01T08:30"
        raise _wrong(column, operator, value, valid)
    return value.replace(" ", "T").replace("+00:00", "Z")


def _is_on_calendar(text: str) -> bool:
    """Return whether a time, or the beginning of one, has a date and an hour that exist."""
    begun = text.removesuffix("Z").removesuffix("+00:00")
    try:
        datetime.fromisoformat(begun + "0001-01-01T00:00:00"[len(begun) :])
    except ValueError:
        return False
    return True


_CHECKS: Mapping[str, Callable[[IndexColumn, str, Value], Value]] = {
    "word": _word,
    "text": _word,
    "json": _word,
    "tags": _word,
    "number": _number,
    "whole": _number,
    "bool": _bool,
    "time": _time,
}


def _is_text(value: str) -> bool:
    """Return whether a text can be stored; one of a command line may have invalid characters."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return len(value) <= LONGEST and "\0" not in value


def _wrong(column: IndexColumn, operator: str, value: Any, valid: str) -> UsageError:
    return UsageError(f"{column.name}{operator}: got {shown(value)}, valid: {valid}")
