"""Rows of an index as Python values, including the columns that a store's rows share."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from typing import Any

from grasp_factory.dataset.index import sql
from grasp_factory.dataset.index.columns import COLUMNS, OF_ROWS, OF_STORES
from grasp_factory.dataset.index.database import place_of, quoted


def shared_columns(connection: sqlite3.Connection) -> dict[int, dict[str, str]]:
    """Return the columns that all rows of a store share, by the store's number."""
    found = connection.execute(f"SELECT id, {', '.join(OF_STORES)} FROM stores ORDER BY id")
    return {number: dict(zip(OF_STORES, rest, strict=True)) for number, *rest in found}


def shown_rows(
    connection: sqlite3.Connection, keys: list[int], facts: sql.SharedColumns
) -> list[dict[str, Any]]:
    """Return rows by their ids, in their order, as Python values by column."""
    names = ", ".join(map(quoted, OF_ROWS))
    found = connection.execute(
        f"SELECT id, {names} FROM episodes WHERE id IN (SELECT value FROM json_each(?))",
        (json.dumps(keys),),
    )
    by_key = {key: dict(zip(OF_ROWS, values, strict=True)) for key, *values in found}
    return [_shown({**by_key[key], **facts[place_of(key)[0]]}) for key in keys if key in by_key]


def _shown(row: dict[str, Any]) -> dict[str, Any]:
    return {column.name: _SHOWN.get(column.kind, _same)(row[column.name]) for column in COLUMNS}


def _same(value: Any) -> Any:
    return value


_SHOWN: dict[str, Callable[[Any], Any]] = {
    "bool": lambda value: None if value is None else bool(value),
    "tags": lambda value: [] if value is None else json.loads(value),
    "json": lambda value: None if value is None else json.loads(value),
}
