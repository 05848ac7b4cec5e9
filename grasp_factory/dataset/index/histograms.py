"""The distribution of a column's values over the rows that a query finds."""

from __future__ import annotations

import itertools
import json
import math
import sqlite3
from collections.abc import Iterator, Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp_factory.dataset.index.choosing import count_rows, found_ids, ids_of, in_order
from grasp_factory.dataset.index.columns import OF_STORES, IndexColumn
from grasp_factory.dataset.index.database import quoted
from grasp_factory.dataset.index.query import Condition, Query, Sort
from grasp_factory.dataset.index.results import NumberBins, WordBars
from grasp_factory.dataset.index.sql import Clause, SharedColumns, condition_clause
from grasp_factory.errors import UsageError

MOST_BARS = 200
MOST_BINS = 200
LARGEST_BARS = 2**51
"""Below this, a float can represent the middle between an integer and the next one."""
_SUCCESS = Condition("success", "=", (True,))


@dataclass(frozen=True, slots=True)
class _Rows:
    """The rows that a query finds."""

    found: Set[int] | None
    """The ids of the rows; None for all rows."""
    good: Set[int]
    """The ids of the successes among them."""

    def counted(self, ids: set[int]) -> tuple[int, int]:
        """Return how many of some rows are found, and how many of these are successes."""
        return len(ids if self.found is None else ids & self.found), len(ids & self.good)


def histogram(
    connection: sqlite3.Connection,
    column: IndexColumn,
    query: Query,
    facts: SharedColumns,
    bins: int,
) -> WordBars | NumberBins:
    """Return how often each value of a column occurs among the rows that a query finds.

    Raises:
        UsageError: for a column that cannot be counted, or a number of bins out of range.
    """
    if column.kind == "json":
        raise UsageError(f"{column.name} is a {column.kind} column, valid: any other kind")
    if not 1 <= bins <= MOST_BINS:
        raise UsageError(f"bins: got {bins}, valid: 1 to {MOST_BINS}")
    found = found_ids(connection, query, facts)
    good = ids_of(connection, condition_clause(_SUCCESS, facts))
    rows = _Rows(found, good if found is None else good & found)
    if column.kind in ("number", "whole"):
        return _bins(connection, column, rows, bins)
    bars = [(value, *rows.counted(ids)) for value, ids in _groups(connection, column, facts)]
    bars = sorted((b for b in bars if b[1]), key=lambda b: (-b[1], b[0] is None, b[0] or ""))
    return WordBars(column=column.name, bars=bars[:MOST_BARS])


def words(
    connection: sqlite3.Connection, column: IndexColumn, facts: SharedColumns, limit: int
) -> list[str]:
    """Return the different values of a column, sorted.

    Raises:
        UsageError: for a column that is not of words or tags.
    """
    if column.kind not in ("word", "tags"):
        raise UsageError(f"{column.name} is a {column.kind} column, valid: one of words or tags")
    if column.name in OF_STORES:
        return sorted({values[column.name] for values in facts.values()})[:limit]
    if column.kind == "tags":
        statement = "SELECT DISTINCT tag FROM row_tags ORDER BY tag LIMIT ?"
        return [word for (word,) in connection.execute(statement, (limit,))]
    name = quoted(column.name)
    statement = (  # steps from value to value; DISTINCT would visit every row
        f"WITH RECURSIVE w(v) AS (SELECT min({name}) FROM episodes UNION ALL"
        f" SELECT (SELECT min({name}) FROM episodes WHERE {name} > v) FROM w WHERE v IS NOT NULL)"
        " SELECT v FROM w WHERE v IS NOT NULL LIMIT ?"
    )
    return [word for (word,) in connection.execute(statement, (limit,))]


def _groups(
    connection: sqlite3.Connection, column: IndexColumn, facts: SharedColumns
) -> Iterator[tuple[str | None, set[int]]]:
    """Yield each value of a column that is not numeric, with the ids of its rows."""
    if column.name in OF_STORES:
        by_text: dict[str | None, set[int]] = {}
        for store, ids in _grouped(connection, '"store"'):
            by_text.setdefault(facts[int(store)][column.name], set()).update(ids)
        yield from by_text.items()
    elif column.kind == "tags":
        yield from _grouped(connection, "tag", "row_tags")
        yield None, ids_of(connection, Clause('"tags" IS NULL'))
    elif column.kind == "bool":
        for value, ids in _grouped(connection, quoted(column.name)):
            yield None if value is None else str(bool(value)).lower(), ids
    elif column.kind == "time":
        yield from _grouped(connection, f"substr({quoted(column.name)}, 1, 10)")
    else:
        yield from _grouped(connection, quoted(column.name))


def _grouped(
    connection: sqlite3.Connection, key: str, table: str = "episodes", clause: Clause | None = None
) -> Iterator[tuple[Any, set[int]]]:
    """Yield each value of an SQL key, with the ids of its rows, from the index of its column."""
    clause = clause or Clause("1")
    for value, text in connection.execute(
        f"SELECT {key}, json_group_array(+id) FROM {table} WHERE {clause.sql} GROUP BY 1",
        clause.values,
    ):
        yield value, set(json.loads(text))


def _bins(
    connection: sqlite3.Connection, column: IndexColumn, rows: _Rows, bins: int
) -> NumberBins:
    name = quoted(column.name)
    total = count_rows(connection) if rows.found is None else len(rows.found)
    span = _span(connection, column, rows.found)
    edges = [] if span is None else _edges(column.kind, *span, bins)
    counts, successes = [0] * max(len(edges) - 1, 0), [0] * max(len(edges) - 1, 0)
    if edges:
        width = (edges[-1] - edges[0]) / len(counts)
        place = f"max(min(CAST(({name} - ?) / ? AS INTEGER), ?), 0)"
        some = Clause(f"{name} IS NOT NULL", (edges[0], width, len(counts) - 1))
        for k, ids in _grouped(connection, place, clause=some):
            counts[k], successes[k] = rows.counted(ids)
    return NumberBins(
        column=column.name,
        units=column.units,
        edges=edges,
        counts=counts,
        successes=successes,
        missing=total - sum(counts),
    )


def _span(
    connection: sqlite3.Connection, column: IndexColumn, found: Set[int] | None
) -> tuple[float, float] | None:
    """Return the least and the greatest value among found rows; None if there is no value."""
    ends: list[float] = []
    for descending in (False, True):
        query = Query(sort=(Sort(column.name, descending),))
        for key in itertools.islice(in_order(connection, query, {}, found), 1):
            statement = f"SELECT {quoted(column.name)} FROM episodes WHERE id = ?"
            (value,) = connection.execute(statement, (key,)).fetchone()
            ends += [] if value is None else [value]
    return (ends[0], ends[1]) if ends else None


def _edges(kind: str, low: float, high: float, bins: int) -> list[float]:
    """Return the edges of bins; if there are few integers, each has a bin centred on it."""
    if kind == "whole" and high - low < bins and max(-low, high) < LARGEST_BARS:
        return [value - 0.5 for value in range(int(low), int(high) + 2)]
    top = float(high) if low < high else low + max(abs(low), 1.0) * 1e-6
    edges: list[float] = np.linspace(float(low), top, bins + 1 if low < high else 2).tolist()
    if edges[0] > low:  # an integer that a float cannot represent
        edges[0] = math.nextafter(edges[0], -math.inf)
    if edges[-1] < high:
        edges[-1] = math.nextafter(edges[-1], math.inf)
    return edges
