"""Converting a query to SQL: names are those of known columns, values are always parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from grasp_factory.dataset.index.columns import BY_NAME, OF_STORES
from grasp_factory.dataset.index.database import quoted
from grasp_factory.dataset.index.query import Condition, Query, Sort, Value

AFTER = "~"
"""Sorts after every character of a time.

A text that begins with t is not less than t, and less than t followed by this."""


@dataclass(frozen=True, slots=True)
class Clause:
    """A part of an SQL statement, with its parameters in their order."""

    sql: str
    values: tuple[Any, ...] = ()


SharedColumns = Mapping[int, Mapping[str, str]]
"""The columns that all rows of a store share, by the store's number."""


def order(query: Query, facts: SharedColumns) -> Clause:
    """Return a query's order; equal rows are in order of store and row, in the last direction."""
    terms: list[str] = []
    values: list[Any] = []
    way = ""
    for sort in query.sort:
        way = " DESC" if sort.descending else ""
        term = _key(sort, facts)
        if term is not None:
            terms.append(f"{term.sql}{way} NULLS LAST")
            values += term.values
    return Clause(", ".join([*terms, f"id{way}"]), tuple(values))


def _key(sort: Sort, facts: SharedColumns) -> Clause | None:
    """Return the expression to order rows by; None if its value is the same for all rows."""
    if sort.column not in OF_STORES:
        return Clause(quoted(sort.column))
    texts = {number: columns[sort.column] for number, columns in facts.items()}
    ranks = {text: rank for rank, text in enumerate(sorted(set(texts.values())))}
    if len(ranks) == 1:
        return None
    pairs = [(number, ranks[text]) for number, text in texts.items()]
    cases = " ".join(["WHEN ? THEN ?"] * len(pairs))
    return Clause(f'CASE "store" {cases} END', tuple(value for pair in pairs for value in pair))


def condition_clause(condition: Condition, facts: SharedColumns) -> Clause:
    """Return the clause of a condition; ``1`` if it holds for all rows, ``0`` if for none."""
    column = BY_NAME[condition.column]
    if condition.column in OF_STORES:
        return _of_stores(condition, facts)
    if column.kind == "tags":
        return _of_tags(condition)
    if condition.operator == "~":
        return _contains(quoted(column.name), str(condition.values[0]))
    if condition.operator in ("=", "!="):
        return _any_of(condition, column.kind)
    return _ordered(condition, column.kind)


def _any_of(condition: Condition, kind: str) -> Clause:
    """Return the clause of ``=``, or of its opposite ``!=``."""
    name, wanted = quoted(condition.column), [v for v in condition.values if v is not None]
    has_null, equal = None in condition.values, condition.operator == "="
    if kind == "time":
        parts = [f"{name} >= ? AND {name} < ?"] * len(wanted)
        found = Clause(" OR ".join(parts), tuple(x for v in wanted for x in (v, f"{v}{AFTER}")))
    elif len(wanted) == 1:
        found = Clause(f"{name} = ?", tuple(wanted))
    else:
        found = Clause(f"{name} IN ({_places(wanted)})", tuple(wanted))
    if not wanted:
        return Clause(f"{name} IS NULL" if equal else f"{name} IS NOT NULL")
    if equal:
        return Clause(f"{found.sql} OR {name} IS NULL" if has_null else found.sql, found.values)
    opposite = f"NOT ({found.sql})"
    return Clause(opposite if has_null else f"{opposite} OR {name} IS NULL", found.values)


def _ordered(condition: Condition, kind: str) -> Clause:
    name, operator, value = quoted(condition.column), condition.operator, condition.values[0]
    if kind == "time" and operator in ("<=", ">"):  # a time means all times that begin with it
        operator, value = {"<=": "<", ">": ">="}[operator], f"{value}{AFTER}"
    return Clause(f"{name} {operator} ?", (value,))


def _contains(name: str, text: str) -> Clause:
    # LIKE ignores the case of ASCII letters only; the table ``folded`` has the case-folded form of
    # other texts.
    folded = text.casefold()
    escaped = "".join(f"!{c}" if c in "!%_" else c for c in folded)
    strange = "SELECT text FROM folded WHERE instr(folded, ?)"
    return Clause(f"{name} LIKE ? ESCAPE '!' OR {name} IN ({strange})", (f"%{escaped}%", folded))


def _of_tags(condition: Condition) -> Clause:
    wanted = [value for value in condition.values if value is not None]
    has = "id IN (SELECT id FROM row_tags WHERE"
    if condition.operator == "~":
        part = _contains("tag", str(wanted[0]))
        return Clause(f"{has} {part.sql})", part.values)
    parts = [f"{has} tag IN ({_places(wanted)}))"] if wanted else []
    parts += ['"tags" IS NULL'] if None in condition.values else []
    found = " OR ".join(parts)
    return Clause(found if condition.operator == "=" else f"NOT ({found})", tuple(wanted))


def _places(values: Sequence[Value]) -> str:
    return ", ".join("?" * len(values))


def _of_stores(condition: Condition, facts: SharedColumns) -> Clause:
    """Return the clause of a column that all rows of a store share, as a choice of stores."""
    chosen = [n for n, columns in facts.items() if _holds(condition, columns[condition.column])]
    if len(chosen) == len(facts):
        return Clause("1")
    if not chosen:
        return Clause("0")
    return Clause(f'"store" IN ({_places(chosen)})', tuple(chosen))


def _holds(condition: Condition, text: str) -> bool:
    values: Sequence[Value] = condition.values
    if condition.operator == "~":
        return str(values[0]).casefold() in text.casefold()
    return (text in values) is (condition.operator == "=")
