"""The rows that a query finds, in its order, without reading the rows themselves.

A condition uses the database's index of its column, and an order uses the index of another column.
Both contain the ids, so that no row is read. If m of n rows are found, the condition costs m steps.
Walking along the order until enough of these rows are reached costs n - m more steps at most.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import sqlite3
from array import array
from collections.abc import Iterator, Set

from grasp_factory.dataset.index.query import Query
from grasp_factory.dataset.index.sql import Clause, SharedColumns, condition_clause, order

FEW = 10
"""Found rows are sorted separately if they are fewer than one in this many of all rows."""
FEW_LEFT_OUT = 4
"""Rows left out are looked up instead if they are at most one in this many of all rows."""


def found_ids(
    connection: sqlite3.Connection, query: Query, facts: SharedColumns
) -> Set[int] | None:
    """Return the ids of the rows that a query finds; None for all rows."""
    found: set[int] | None = None
    for condition in query.conditions:
        clause = condition_clause(condition, facts)
        if clause.sql != "1":
            ids = ids_of(connection, clause)
            found = ids if found is None else found & ids
        if found is not None and not found:
            break
    return found


def count_rows(connection: sqlite3.Connection) -> int:
    """Return how many rows an index has."""
    count: int = connection.execute("SELECT count(*) FROM episodes").fetchone()[0]
    return count


def count_found(connection: sqlite3.Connection, query: Query, facts: SharedColumns) -> int:
    """Return how many rows a query finds."""
    found = found_ids(connection, query, facts)
    return count_rows(connection) if found is None else len(found)


def in_order(
    connection: sqlite3.Connection, query: Query, facts: SharedColumns, found: Set[int] | None
) -> Iterator[int]:
    """Return an iterator over the ids of found rows, in a query's order."""
    by = order(query, facts)
    if found is None:
        return _walk(connection, by, Clause("1"))
    if len(found) * FEW < count_rows(connection):
        if not query.sort:
            return iter(sorted(found))
        some = Clause("id IN (SELECT value FROM json_each(?))", (json.dumps(list(found)),))
        return _walk(connection, by, some)
    return filter(found.__contains__, _walk(connection, by, Clause("1")))


def all_in_order(connection: sqlite3.Connection, query: Query, facts: SharedColumns) -> array[int]:
    """Return the ids of all rows that a query finds, in its order."""
    return array("q", in_order(connection, query, facts, found_ids(connection, query, facts)))


def some_in_order(
    connection: sqlite3.Connection, query: Query, facts: SharedColumns, offset: int, limit: int
) -> tuple[int, list[int]]:
    """Return how many rows a query finds, and the ids of some of them in its order."""
    left_out = _left_out(connection, query, facts)
    found = None if left_out is not None else found_ids(connection, query, facts)
    total = count_rows(connection) - len(left_out or ()) if found is None else len(found)
    stop = min(offset + limit, total)  # no step beyond the last found row
    if offset >= stop:
        return total, []
    rows = in_order(connection, query, facts, found)
    if left_out is not None:
        rows = itertools.filterfalse(left_out.__contains__, rows)
    return total, list(itertools.islice(rows, offset, stop))


def _left_out(
    connection: sqlite3.Connection, query: Query, facts: SharedColumns
) -> set[int] | None:
    """Return the ids of the rows that a query's only condition leaves out, if they are few.

    Fetching these is less work than fetching the others. A search for a text is not considered: it
    costs the same for any number of rows.
    """
    if len(query.conditions) != 1 or query.conditions[0].operator == "~":
        return None
    condition, rows = query.conditions[0], count_rows(connection)
    if condition.operator == "!=":
        clause = condition_clause(dataclasses.replace(condition, operator="="), facts)
        left = _count(connection, clause)
    else:
        holds = condition_clause(condition, facts)
        left = rows - _count(connection, holds)
        clause = Clause(f"({holds.sql}) IS NOT TRUE", holds.values)
    return None if left * FEW_LEFT_OUT > rows else ids_of(connection, clause)


def _count(connection: sqlite3.Connection, clause: Clause) -> int:
    statement = f"SELECT count(*) FROM episodes WHERE {clause.sql}"
    count: int = connection.execute(statement, clause.values).fetchone()[0]
    return count


def ids_of(connection: sqlite3.Connection, clause: Clause) -> set[int]:
    """Return the ids of the rows for which a clause holds."""
    # All ids in one JSON text are three times as fast as one result row for each id. The plus keeps
    # SQLite from walking along the ids, which would read the rows.
    statement = f"SELECT json_group_array(+id) FROM episodes WHERE {clause.sql}"
    (text,) = connection.execute(statement, clause.values).fetchone()
    return set(json.loads(text))


def _walk(connection: sqlite3.Connection, by: Clause, some: Clause) -> Iterator[int]:
    rows = connection.execute(
        f"SELECT id FROM episodes WHERE {some.sql} ORDER BY {by.sql}", (*some.values, *by.values)
    )
    return itertools.chain.from_iterable(rows)
