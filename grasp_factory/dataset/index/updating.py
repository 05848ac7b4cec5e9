"""Updating an index from its stores; only blocks that changed are read."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.index.building import add_blocks, add_store, annotate, remove_rows
from grasp_factory.dataset.index.database import row_id
from grasp_factory.dataset.index.indexed_store import IndexSource, state_of


def stale_stores(connection: sqlite3.Connection) -> list[tuple[int, Path]]:
    """Return number and path of each store that has changed since the last update, or may have.

    Raises:
        StoreError: if one is gone.
    """
    stored = connection.execute("SELECT id, path, state, annotations FROM stores ORDER BY id")
    out = []
    for number, text, state, log_state in stored.fetchall():
        path = store_path(text)
        said = json.dumps(AnnotationLog(path).state())
        if state is None or state != state_of(path) or said != log_state:
            out.append((number, path))
    return out


def has_changed(connection: sqlite3.Connection, number: int, path: Path) -> bool:
    """Return whether the blocks or annotations of a store differ from those of the index.

    Raises:
        StoreError: if it is gone or damaged.
    """
    (root, said) = connection.execute(
        "SELECT root, annotations FROM stores WHERE id = ?", (number,)
    ).fetchone()
    source = IndexSource(path)
    if source.root != root or json.dumps(AnnotationLog(path).state()) != said:
        return True
    return source.blocks() != _known_blocks(connection, number)


def update_store(
    connection: sqlite3.Connection, number: int, path: Path, log: AnnotationLog
) -> int:
    """Update the rows of a store; return how many changed.

    Raises:
        StoreError: if it is gone or damaged.
    """
    state = state_of(path)  # read first: a later change is found the next time
    changed: set[int] = set()
    (before,) = connection.execute("SELECT state FROM stores WHERE id = ?", (number,)).fetchone()
    if state is None or state != before:
        source = IndexSource(path)
        changed = _update_blocks(connection, number, source)
        add_store(connection, number, source, state)
    changed.update(annotate(connection, number, log))
    return len(changed)


def _update_blocks(connection: sqlite3.Connection, number: int, source: IndexSource) -> set[int]:
    """Read the blocks that changed; return the ids of added, changed and removed rows."""
    now, changed = source.blocks(), set[int]()
    (root,) = connection.execute("SELECT root FROM stores WHERE id = ?", (number,)).fetchone()
    if root != source.root:  # another store has replaced it
        changed.update(remove_rows(connection, row_id(number, 0), row_id(number + 1, 0)))
        connection.execute("DELETE FROM blocks WHERE store = ?", (number,))
    known = _known_blocks(connection, number)
    for block in (block for block, marker in known.items() if now.get(block) != marker):
        start, stop = source.span(block)
        changed.update(remove_rows(connection, row_id(number, start), row_id(number, stop)))
        connection.execute("DELETE FROM blocks WHERE store = ? AND block = ?", (number, block))
    new = {block: marker for block, marker in now.items() if known.get(block) != marker}
    changed.update(add_blocks(connection, number, source, new))
    return changed


def _known_blocks(connection: sqlite3.Connection, number: int) -> dict[int, str]:
    found = connection.execute("SELECT block, marker FROM blocks WHERE store = ?", (number,))
    return dict(found.fetchall())
