"""Conditions that no row can fulfil: a word that no row has, and words that exclude each other."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.dataset.index.columns import BY_NAME
from grasp_factory.dataset.index.handle import Index
from grasp_factory.dataset.index.query import Condition, Query
from grasp_factory.errors import UsageError, shown, unknown_value

MOST_WORDS = 5_000
"""Words of a column among which the nearest is searched."""
_ONE_VALUE = ("word", "text", "number", "whole", "bool")
"""Kinds of columns that have one value a row; a part of a time may contain another."""


def check_found(index: Index, query: Query) -> None:
    """Check that conditions are not mistakes, which would find nothing and say nothing.

    Raises:
        UnknownNameError: for a word that no row has, naming the nearest and the valid ones.
        UsageError: for several values of a column of which each row has one, and for bounds between
            which there is no number.
    """
    _check_ranges(query)
    asked: dict[str, list[Condition]] = {}
    for condition in query.conditions:
        if condition.operator == "=":
            asked.setdefault(condition.column, []).append(condition)
    _check_agree(asked)
    for name, conditions in asked.items():
        column = BY_NAME[name]
        if column.kind == "word" and not column.words:
            known = set(index.words(name, MOST_WORDS))
            for value in {v for condition in conditions for v in condition.values}:
                is_there = value is None or not known or value in known
                if not is_there and not _has(index, name, str(value)):
                    raise unknown_value(name, str(value), known)


def _check_agree(asked: Mapping[str, list[Condition]]) -> None:
    for name, conditions in asked.items():
        sets = [set(condition.values) for condition in conditions]
        if BY_NAME[name].kind in _ONE_VALUE and not set.intersection(*sets):
            texts = [",".join(map(str, condition.values)) for condition in conditions]
            got = " and ".join(f"{name}={shown(text)}" for text in texts)
            valid = f"{name}=[{','.join(texts)}] for any of them"
            raise UsageError(f"{got}: no row has both, valid: {valid}")


def _check_ranges(query: Query) -> None:
    """Check that a number can be above all lower bounds of its column and below all upper ones."""
    lows: dict[str, list[Condition]] = {}
    highs: dict[str, list[Condition]] = {}
    for condition in query.conditions:
        if BY_NAME[condition.column].kind in ("number", "whole"):
            sides = {">": lows, ">=": lows, "<": highs, "<=": highs}
            if condition.operator in sides:
                sides[condition.operator].setdefault(condition.column, []).append(condition)
    for name in lows.keys() & highs.keys():
        low, high = max(lows[name], key=_bound), min(highs[name], key=_bound)
        if _bound(low) > _bound(high):
            got = " and ".join(f"{name}{one.operator}{one.values[0]}" for one in (low, high))
            raise UsageError(f"{got}: no number is both")


def _bound(condition: Condition) -> float:
    (bound,) = condition.values
    assert isinstance(bound, int | float)
    return float(bound)


def _has(index: Index, column: str, value: str) -> bool:
    """Return whether any row has a value, also where there are more than ``MOST_WORDS``."""
    return index.count(Query((Condition(column, "=", (value,)),))) > 0
