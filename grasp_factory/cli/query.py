"""The command that searches an index of stores: ``query``."""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.completion import column_names, completes
from grasp_factory.cli.params import STORE_PATH, Command, json_option, option
from grasp_factory.cli.printing import print_json, say, say_lines
from grasp_factory.errors import UsageError, lookup

if TYPE_CHECKING:
    from grasp_factory.dataset.index import Index, Query

SHOWN = ("row", "outcome", "object_id", "policy", "split", "lift_height", "data_quality", "tags")
"""Columns of the table without --columns; those of conditions and orders stand before the last."""
MOST_LINES = 50
"""Rows of the table without --limit."""
PAGE = 5000
"""Rows in memory at a time while they are printed."""

_output = partial(option, heading="Output")


@click.command(
    cls=Command,
    examples=(
        "grasp-factory query grasps.zarr --where policy=uniform --where 'n_steps>300'",
        "grasp-factory query grasps.zarr --where split=test --sort=-lift_height",
        "grasp-factory query grasps.zarr --columns row,outcome --csv > outcomes.csv",
        "grasp-factory query grasps.zarr --where success=true --count",
        "grasp-factory query --where help",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, type=STORE_PATH)
@option(
    "--where",
    metavar="CONDITION",
    multiple=True,
    help="COLUMN=VALUE, !=, <, <=, >, >=, COLUMN~TEXT (contains), COLUMN=[A,B] (any of),"
    " COLUMN=null (no value). Repeatable; all must hold. `--where help` lists the columns.",
)
@option(
    "--sort",
    metavar="COLUMN,...",
    default="",
    shell_complete=completes(column_names),
    help="Columns to sort by; -COLUMN sorts in descending order.",
)
@option(
    "--limit",
    metavar="N",
    type=click.IntRange(min=0),
    help="Largest number of rows.  [default: 50 in the table, otherwise all]",
)
@option(
    "--offset",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    help="Number of rows to skip.",
)
@option(
    "--index",
    "place",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Index file.  [default: in the cache]",
)
@_output(
    "--columns",
    metavar="A,B,...",
    shell_complete=completes(column_names),
    help="Columns to print.",
)
@json_option("Output")
@_output("--csv", "as_csv", is_flag=True, help="Print CSV.")
@_output("--ids", is_flag=True, help="Print episode indices, for --ids of other commands.")
@_output("--count", "only_count", is_flag=True, help="Print the number of episodes.")
def query(
    paths: tuple[Path, ...],
    *,
    where: tuple[str, ...],
    sort: str,
    limit: int | None,
    offset: int,
    columns: str | None,
    as_json: bool,
    as_csv: bool,
    ids: bool,
    only_count: bool,
    place: Path | None,
) -> None:
    """Find episodes that match conditions.

    Prints the episodes of the stores at PATH, or of an index file, for which all conditions hold.
    Builds the index if it does not exist, and updates it otherwise.
    """
    from grasp_factory.cli.bars import counted
    from grasp_factory.dataset.index import Query, check_found, fresh

    if "help" in where:
        say(_help())
        return
    if as_json + as_csv + ids + only_count > 1:
        raise UsageError("--json, --csv, --ids and --count: got several, valid: one of them")
    asked = Query.parse(where, sort)
    names = None if columns is None else _columns(columns)
    with counted("on_row") as hooks:
        found = fresh(paths, place, **hooks)
    with found:
        check_found(found, asked)
        if only_count:
            say(found.count(asked))
        elif ids:
            _print_ids(found, asked, offset, limit)
        elif as_json:
            _print_json(found, asked, offset, limit, names)
        elif as_csv:
            _print_csv(found, asked, offset, limit, names)
        else:
            _print_table(found, asked, offset, limit, names)


def _columns(text: str) -> list[str]:
    from grasp_factory.dataset.index import COLUMNS

    names = [name.strip() for name in text.split(",")]
    known = {column.name: column for column in COLUMNS}
    return [lookup(known, "column", name).name for name in names]


def _help() -> str:
    from grasp_factory.core.text_format import table
    from grasp_factory.dataset.index import COLUMNS, OPERATORS, SYNTAX

    rows = [(c.name, c.kind, c.units, " ".join(OPERATORS[c.kind]), c.description) for c in COLUMNS]
    notes = (
        f"CONDITION: {SYNTAX}",
        'Quote a value with a comma, or the text null, as in JSON: COLUMN=["a,b","null"].',
        "!= is the opposite of =; it also holds for rows without a value. =null and !=null work"
        " with every column.",
        "tags=odd holds for rows with this tag. Times are in UTC, whole or in part:"
        " created_at>=2026-03.",
    )
    return "\n".join(
        [*notes, "", table([("column", "kind", "unit", "operators", "meaning"), *rows])]
    )


def _rows(
    found: Index, asked: Query, offset: int, limit: int | None, each: Callable[[Any], None]
) -> int:
    """Call ``each`` for the rows, page by page; return the number of rows that match."""
    total, at = found.count(asked), offset
    stop = total if limit is None else min(total, offset + limit)
    while at < stop:
        page = found.page(asked, at, min(PAGE, stop - at))
        if not page.rows:
            break
        for row in page.rows:
            each(row)
        at += len(page.rows)
    return total


def _print_ids(found: Index, asked: Query, offset: int, limit: int | None) -> None:
    from grasp_factory.dataset.selection import selection_lines

    stores = found.stores
    paths = {store.id: store.path for store in stores}
    chosen = found.ids(asked)[offset : None if limit is None else offset + limit]
    lines = selection_lines(((paths[store], row) for store, row in chosen), named=len(stores) > 1)
    say_lines(lines)


def _print_json(
    found: Index, asked: Query, offset: int, limit: int | None, names: Sequence[str] | None
) -> None:
    rows: list[dict[str, Any]] = []
    total = _rows(found, asked, offset, limit, lambda row: rows.append(_part(row, names)))
    print_json({"total": total, "rows": rows})


def _print_csv(
    found: Index, asked: Query, offset: int, limit: int | None, names: Sequence[str] | None
) -> None:
    from grasp_factory.core.csv_text import CsvWriter
    from grasp_factory.dataset.index import COLUMNS

    chosen = names or [column.name for column in COLUMNS]
    writer = CsvWriter(sys.stdout)
    writer.row(chosen)
    _rows(found, asked, offset, limit, lambda row: writer.row(_cells(row, chosen)))


def _cells(row: dict[str, Any], names: Sequence[str]) -> list[Any]:
    """Return a row's values for CSV: None for null, lists and mappings as JSON."""
    out = []
    for name in names:
        value = row[name]
        if isinstance(value, list | dict):
            value = json.dumps(value, ensure_ascii=False) if value else None
        elif isinstance(value, bool):
            value = str(value).lower()
        out.append(value)
    return out


def _print_table(
    found: Index, asked: Query, offset: int, limit: int | None, names: Sequence[str] | None
) -> None:
    from grasp_factory.core.text_format import count, table

    several = len(found.stores) > 1
    chosen = list(names or _shown(asked, several=several))
    lines: list[list[str]] = []
    total = _rows(
        found,
        asked,
        offset,
        MOST_LINES if limit is None else limit,
        lambda row: lines.append([_cell(row[name]) for name in chosen]),
    )
    numbers = {"number", "whole"}
    kinds = _kinds()
    right = [k for k, name in enumerate(chosen) if kinds[name] in numbers]
    head = f"{count(total, 'episode')}"
    if several:
        say("\n".join(f"store {s.id}: {s.path}" for s in found.stores), err=True)
    if lines:
        say(table([chosen, *lines], right))
        if len(lines) < total:
            head += f", {len(lines)} shown"
    say(head, err=True)


def _shown(asked: Query, *, several: bool) -> list[str]:
    """Return the columns of the table: the usual ones, and those that are asked for."""
    wanted = [*(c.column for c in asked.conditions), *(sort.column for sort in asked.sort)]
    more = [name for name in wanted if name not in (*SHOWN, "store")]
    return [*(["store"] if several else []), *SHOWN[:-1], *dict.fromkeys(more), SHOWN[-1]]


def _kinds() -> dict[str, str]:
    from grasp_factory.dataset.index import COLUMNS

    return {column.name: column.kind for column in COLUMNS}


def _cell(value: Any) -> str:
    """Return a value as one line for a table."""
    if value is None or value == []:
        return "-"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(value)
    text = json.dumps(value) if isinstance(value, dict) else str(value)
    return "".join(c if c.isprintable() else " " for c in text)


def _part(row: dict[str, Any], names: Sequence[str] | None) -> dict[str, Any]:
    return row if names is None else {name: row[name] for name in names}
