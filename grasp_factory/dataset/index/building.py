"""Building an index of stores, and changing its rows."""

from __future__ import annotations

import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.cache import cache_dir, digest
from grasp_factory.core.object_storage.address import RemotePath, absolute_path, real_path
from grasp_factory.core.object_storage.client import endpoint
from grasp_factory.dataset.annotations import Annotation, AnnotationLog
from grasp_factory.dataset.index.columns import BY_NAME, OF_PEOPLE, OF_ROWS, OF_STORES
from grasp_factory.dataset.index.database import built_aside, cannot_write, quoted, row_id
from grasp_factory.dataset.index.indexed_store import IndexSource, state_of
from grasp_factory.errors import UsageError, shown
from grasp_factory.writers.zarr.header import read_attributes


@dataclass(frozen=True, slots=True, kw_only=True)
class Built:
    """The result of building an index."""

    path: Path
    stores: tuple[Path, ...]
    rows: int
    seconds: float
    bytes: int


def default_path(stores: Sequence[Path]) -> Path:
    """Return the path of the index of some stores, in a folder of the cache, which is made.

    Raises:
        UsageError: if there is no place for the cache, or it cannot be written.
    """
    name = digest("\n".join(map(_identity, stores)).encode())
    folder = cache_dir() / "indexes"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error.strerror or str(error)) from None
    return folder / f"{name}.sqlite"


def _identity(store: Path) -> str:
    """Return the absolute path of a store; of one in object storage, who answers there too."""
    known = f"{endpoint(store)} " if isinstance(store, RemotePath) else ""
    return f"{known}{absolute_path(store)}"


def places(stores: Sequence[Path]) -> list[Path]:
    """Return the absolute paths of stores, in their order.

    Raises:
        UsageError: if there are no stores, if one is named twice, also through a link, or if a
            path is not UTF-8.
    """
    paths = list(map(absolute_path, stores))
    if not paths:
        raise UsageError("no store is named, valid: stores, or one index file")
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            what = "an index keeps paths as text, and this one is not UTF-8"
            raise UsageError(f"store {shown(str(path))}: {what}; rename it") from None
    real = list(map(real_path, paths))
    for path, target in zip(paths, real, strict=True):
        if real.count(target) > 1:
            raise UsageError(f"store {path} is named {real.count(target)} times, valid: each once")
    return paths


def build(
    stores: Sequence[Path],
    out: Path,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[int], None] = lambda row: None,
) -> Built:
    """Build the index of some stores; an existing index at ``out`` is replaced at the end.

    Args:
        stores: The stores; the position of each is its number in the index.
        out: The file of the index.
        on_start: Called once, with the number of rows to read.
        on_row: Called after each row, with its number in its store.

    Raises:
        StoreMismatchError: if there is no store at a path.
        StoreError: if a store is too damaged to be read.
        UsageError: if the index cannot be written, or ``out`` is a file that is not an index.
    """
    started = time.monotonic()
    paths, place = places(stores), Path(os.path.realpath(out))
    for path in paths:
        if real_path(path) in (place, *place.parents):
            raise UsageError(f"index {out}: it would lie in the store {path}; choose another file")
    states = [state_of(path) for path in paths if read_attributes(path)]
    sources = [IndexSource(path) for path in paths]
    blocks = [source.blocks() for source in sources]
    on_start(sum(s.episodes(b) for s, b in zip(sources, blocks, strict=True)))
    rows = 0
    with built_aside(out) as connection:
        for number, source in enumerate(sources):
            add_store(connection, number, source, states[number])
            rows += len(add_blocks(connection, number, source, blocks[number], on_row))
            annotate(connection, number, AnnotationLog(source.path))
    size = out.stat().st_size
    seconds = time.monotonic() - started
    return Built(path=out, stores=tuple(paths), rows=rows, seconds=seconds, bytes=size)


def add_store(
    connection: sqlite3.Connection, number: int, source: IndexSource, state: str | None
) -> None:
    """Insert or replace a store and the values that its rows share, without its rows."""
    facts = source.facts
    connection.execute(
        f"REPLACE INTO stores (id, path, root, state, {', '.join(OF_STORES)})"
        f" VALUES (?, ?, ?, ?{', ?' * len(OF_STORES)})",
        (number, str(source.path), source.root, state, *(facts[name] for name in OF_STORES)),
    )


def add_blocks(
    connection: sqlite3.Connection,
    number: int,
    source: IndexSource,
    blocks: Mapping[int, str],
    on_row: Callable[[int], None] = lambda row: None,
) -> list[int]:
    """Insert rows of blocks that are not indexed yet; return the ids of the rows."""
    columns = ", ".join(map(quoted, OF_ROWS))
    insert = f"INSERT INTO episodes (id, {columns}) VALUES (?{', ?' * len(OF_ROWS)})"
    place, store = OF_ROWS.index("row"), OF_ROWS.index("store")
    texts = [k for k, name in enumerate(OF_ROWS) if BY_NAME[name].kind in ("word", "text")]
    ids: list[int] = []
    for rows in source.rows(blocks):
        keys = [row_id(number, row[place]) for row in rows]
        placed = ((*row[:store], number, *row[store + 1 :]) for row in rows)
        connection.executemany(insert, ((key, *row) for key, row in zip(keys, placed, strict=True)))
        fold(connection, {row[k] for k in texts for row in rows})
        ids += keys
        for row in rows:
            on_row(row[place])
    markers = ((number, block, marker) for block, marker in blocks.items())
    connection.executemany("REPLACE INTO blocks VALUES (?, ?, ?)", markers)
    return ids


def remove_rows(connection: sqlite3.Connection, first: int, stop: int) -> list[int]:
    """Delete the rows with ids from ``first`` to ``stop`` - 1; return the deleted ids."""
    span = (first, stop)
    connection.execute("DELETE FROM row_tags WHERE id >= ? AND id < ?", span)
    gone = connection.execute("DELETE FROM episodes WHERE id >= ? AND id < ? RETURNING id", span)
    return [key for (key,) in gone.fetchall()]


def annotate(connection: sqlite3.Connection, number: int, log: AnnotationLog) -> list[int]:
    """Update the annotations of a store's rows; return the ids of the rows that changed."""
    state = json.dumps(log.state())  # read first: a later change is found the next time
    said = log.annotations()
    first, last = row_id(number, 0), row_id(number + 1, 0)
    names = ", ".join(quoted(name) for name in OF_PEOPLE)
    now = {
        row[0]: row[1:]
        for row in connection.execute(
            f"SELECT id, {names} FROM episodes WHERE id >= ? AND id < ? AND marks IS NOT NULL",
            (first, last),
        )
    }
    changed = [
        key
        for key in {*now, *(row_id(number, row) for row in said)}
        if set_annotation(connection, key, said.get(key - first), now.get(key))
    ]
    connection.execute("UPDATE stores SET annotations = ? WHERE id = ?", (state, number))
    return changed


def set_annotation(
    connection: sqlite3.Connection,
    key: int,
    annotation: Annotation | None,
    before: tuple[Any, ...] | None = None,
) -> bool:
    """Write the annotation of a row; return whether the row exists and has changed."""
    found = connection.execute("SELECT quality FROM episodes WHERE id = ?", (key,)).fetchone()
    if found is None:
        return False
    values = _values(annotation, found[0])
    if values == before:
        return False
    named = ", ".join(f"{quoted(name)} = ?" for name in OF_PEOPLE)
    connection.execute(f"UPDATE episodes SET {named} WHERE id = ?", (*values, key))
    connection.execute("DELETE FROM row_tags WHERE id = ?", (key,))
    if annotation is not None:
        pairs = [(tag, key) for tag in annotation.tags]
        connection.executemany("INSERT INTO row_tags VALUES (?, ?)", pairs)
        fold(connection, {*annotation.tags, annotation.note})
    return True


def _values(annotation: Annotation | None, quality: int | None) -> tuple[Any, ...]:
    """Return a row's values of ``OF_PEOPLE``; ``quality`` is the store's own."""
    if annotation is None:
        return None, None, None, None, quality
    return (
        annotation.outcome,
        json.dumps(annotation.tags, ensure_ascii=False) if annotation.tags else None,
        annotation.note or None,
        len(annotation.marks),
        quality if annotation.quality is None else annotation.quality,
    )


def fold(connection: sqlite3.Connection, texts: Iterable[str | None]) -> None:
    """Store the case-folded form of texts whose case SQLite cannot ignore: those beyond ASCII."""
    strange = [(t, t.casefold()) for t in texts if t and not (t.isascii() and "\0" not in t)]
    connection.executemany("REPLACE INTO folded VALUES (?, ?)", strange)
