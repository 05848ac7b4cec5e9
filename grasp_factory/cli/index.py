"""The commands that make an index of stores, and ask it."""

# ruff: noqa: PLC0415

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from grasp_factory.cli.params import AS_JSON, print_json
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import UsageError, lookup

if TYPE_CHECKING:
    from grasp_factory.dataset.index import Index, Query

SHOWN = ("row", "outcome", "object_id", "policy", "split", "lift_height", "data_quality", "tags")
"""Columns of the table that people get."""
MOST_LINES = 50
"""Rows of the table without --limit."""
PAGE = 5000
"""Rows that are held at once while they are printed."""
PATHS = click.argument(
    "paths", metavar="PATH...", nargs=-1, required=True, type=click.Path(path_type=Path)
)


@click.command()
@PATHS
@click.option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="The index.  [default: PATH.index.sqlite, beside the store]",
)
@AS_JSON
def index(paths: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    """Make an index of stores, anew.

    An SQLite file with a row for each episode of the stores at PATH, for `query` and `browse`. It
    follows from the stores and from what people said of their episodes: delete it at any time.
    Several stores need --out.
    """
    from grasp_factory.cli.progress import counted
    from grasp_factory.core.text_format import count, size_text
    from grasp_factory.dataset.index import build, default_path

    if out is None and len(paths) > 1:
        raise UsageError("several stores in one index need a place for it: --out FILE")
    with counted("on_row") as hooks:
        built = build(paths, out or default_path(paths[0]), **hooks)
    if as_json:
        stores = [str(store) for store in built.stores]
        print_json({**to_plain(built), "path": str(built.path), "stores": stores})
        return
    click.echo(
        f"{built.path}: {count(built.rows, 'row')} of {count(len(built.stores), 'store')} in"
        f" {built.seconds:.1f} s, {size_text(built.bytes)}"
    )


@click.command()
@click.argument("paths", metavar="PATH...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--where",
    metavar="CONDITION",
    multiple=True,
    help="COLUMN=VALUE, !=, <, <=, >, >=, COLUMN~TEXT (contains), COLUMN=[A,B] (any of),"
    " COLUMN=null. Repeatable: all must hold. `--where help` lists the columns.",
)
@click.option("--sort", metavar="COLUMN,...", default="", help="Order; -COLUMN turns it round.")
@click.option("--limit", type=click.IntRange(min=0), help="Rows at most.  [default: 50; else all]")
@click.option("--offset", type=click.IntRange(min=0), default=0, help="Rows to pass over.")
@click.option("--columns", metavar="A,B,...", help="What to print of each row.")
@AS_JSON
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
@click.option("--ids", is_flag=True, help="Print a list that --ids of other commands takes.")
@click.option("--count", "only_count", is_flag=True, help="Print how many there are.")
@click.option(
    "--index",
    "place",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="The index.  [default: beside the store; of several stores in the cache]",
)
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
    """Find episodes by what is known of them.

    Prints those of the stores at PATH, or of one index file, for which every --where holds. The
    index is made if there is none, and brought up to date.
    """
    from grasp_factory.cli.progress import counted
    from grasp_factory.dataset.index import Query, fresh

    if "help" in where:
        click.echo(_help())
        return
    if as_json + as_csv + ids + only_count > 1:
        raise UsageError("--json, --csv, --ids, --count: valid: one of them")
    asked = Query.parse(where, sort)
    names = None if columns is None else _columns(columns)
    with counted("on_row") as hooks:
        found = fresh(paths, place, **hooks)
    with found:
        if only_count:
            click.echo(found.count(asked))
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
        'A value with a comma, or the word null itself: COLUMN=["a,b","null"], quoted as in JSON.',
        "!= is the opposite of =: rows without a value fulfil it. =null, !=null: with any column.",
        "tags=odd: has this tag. A time is a date or its beginning, in UTC: created_at>=2026-03.",
    )
    return "\n".join([*notes, "", table([("column", "kind", "unit", "", "what"), *rows])])


def _rows(
    found: Index, asked: Query, offset: int, limit: int | None, each: Callable[[Any], None]
) -> int:
    """Go over rows page by page; return how many the query finds."""
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
    sys.stdout.writelines(f"{line}\n" for line in lines)


def _print_json(
    found: Index, asked: Query, offset: int, limit: int | None, names: Sequence[str] | None
) -> None:
    rows: list[dict[str, Any]] = []
    total = _rows(found, asked, offset, limit, lambda row: rows.append(_part(row, names)))
    print_json({"total": total, "rows": rows})


def _print_csv(
    found: Index, asked: Query, offset: int, limit: int | None, names: Sequence[str] | None
) -> None:
    from grasp_factory.dataset.index import COLUMNS

    chosen = names or [column.name for column in COLUMNS]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(chosen)
    _rows(found, asked, offset, limit, lambda row: writer.writerow(_cells(row, chosen)))


def _cells(row: dict[str, Any], names: Sequence[str]) -> list[Any]:
    """Return a row's values as CSV has them: nothing for null, lists and mappings as JSON."""
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
    chosen = list(names or (("store", *SHOWN) if several else SHOWN))
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
        click.echo("\n".join(f"store {s.id}: {s.path}" for s in found.stores), err=True)
    if lines:
        click.echo(table([chosen, *lines], right))
        if len(lines) < total:
            head += f", of which {len(lines)} are shown"
    click.echo(head, err=True)


def _kinds() -> dict[str, str]:
    from grasp_factory.dataset.index import COLUMNS

    return {column.name: column.kind for column in COLUMNS}


def _cell(value: Any) -> str:
    """Return a value as a table shows it, in one line."""
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
