"""An open index: queries, histograms, neighbours, and updates from its stores."""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from array import array
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.dataset.annotations import Annotation, AnnotationLog
from grasp_factory.dataset.index import histograms, updating
from grasp_factory.dataset.index.building import set_annotation
from grasp_factory.dataset.index.choosing import all_in_order, count_found, some_in_order
from grasp_factory.dataset.index.columns import BY_NAME
from grasp_factory.dataset.index.database import (
    connect,
    damaged,
    gone,
    limited,
    place_of,
    row_id,
    version_of,
    writing,
)
from grasp_factory.dataset.index.query import Query
from grasp_factory.dataset.index.results import IndexedStore, Neighbours, NumberBins, Page, WordBars
from grasp_factory.dataset.index.row_values import shared_columns, shown_rows
from grasp_factory.errors import UsageError, lookup

NEAR = 10_000
"""Largest offset of a page that is looked up alone; beyond it, the whole order is kept."""
KEPT_ORDERS = 8
"""Maximum number of queries whose ordered row ids are kept in memory, 8 bytes per row."""


class Index:
    """An open index. Threads may share it: each has its own connection, which only reads.

    Attributes:
        path: the path of the index's file.
        patience_s: the time limit of each read, in seconds.
    """

    def __init__(self, path: Path) -> None:
        """Open an index; ``fresh`` also builds and updates it.

        Raises:
            UsageError: if the file cannot be read, or is not an index.
        """
        self.path, self.patience_s = path, float("inf")
        self._threads = threading.local()
        self._connections: list[sqlite3.Connection] = []
        self._lock = threading.Lock()
        self._refreshing = threading.Lock()
        self._orders: OrderedDict[tuple[Any, ...], array[int]] = OrderedDict()
        self._logs: dict[Path, AnnotationLog] = {}
        version_of(path)

    def close(self) -> None:
        """Close the connections of all threads."""
        with self._lock:
            for connection in self._connections:
                connection.close()
            self._connections.clear()
            self._threads = threading.local()

    def __enter__(self) -> Index:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the index."""
        self.close()

    @property
    def stores(self) -> tuple[IndexedStore, ...]:
        """The stores, in the order of their numbers."""
        counts = (
            "SELECT count(*) FROM episodes WHERE id >= ? AND id < ?",
            'SELECT count(*) FROM episodes WHERE "status" = ? AND id >= ? AND id < ?',
        )
        out = []
        with self._reading() as connection:
            for number, path in connection.execute("SELECT id, path FROM stores ORDER BY id"):
                span = (row_id(number, 0), row_id(number + 1, 0))
                rows = connection.execute(counts[0], span).fetchone()[0]
                committed = connection.execute(counts[1], ("committed", *span)).fetchone()[0]
                where = store_path(path)
                store = IndexedStore(
                    id=number, path=where, name=where.name, rows=rows, committed=committed
                )
                out.append(store)
        return tuple(out)

    def refresh(self) -> int:
        """Update the index from stores that changed; return how many rows changed.

        Raises:
            StoreError: if a store is gone or damaged.
            UsageError: if something changed and the index cannot be written.
        """
        with self._refreshing:
            with self._reading() as connection:
                stale = updating.stale_stores(connection)
            if not stale:
                return 0
            try:
                with writing(self.path) as connection:
                    # Another process may have updated the index while this one waited.
                    return sum(
                        updating.update_store(connection, number, path, self._log(path))
                        for number, path in updating.stale_stores(connection)
                    )
            except UsageError:
                with self._reading() as connection:
                    if any(updating.has_changed(connection, *store) for store in stale):
                        raise
                return 0  # nothing changed, although it was uncertain before

    def annotated(self, store: int, said: Mapping[int, Annotation | None]) -> None:
        """Write annotations of rows to the index, after they were written to the log.

        Raises:
            UsageError: if the index cannot be written.
        """
        with self._refreshing, writing(self.path) as connection:
            for row, annotation in said.items():
                set_annotation(connection, row_id(store, row), annotation)

    def page(self, query: Query, offset: int = 0, limit: int = 60) -> Page:
        """Return how many rows a query finds, and some of them.

        Raises:
            StoreError: if the index is damaged.
        """
        with self._reading() as connection:
            facts = shared_columns(connection)
            known = self._known(connection, query)
            if known is None and offset > NEAR:
                known = self._ordered(connection, query)
            if known is not None:
                total, keys = len(known), known[offset : offset + limit].tolist()
            else:
                total, keys = some_in_order(connection, query, facts, offset, limit)
            return Page(total=total, rows=shown_rows(connection, keys, facts))

    def count(self, query: Query) -> int:
        """Return how many rows a query finds."""
        with self._reading() as connection:
            return count_found(connection, query, shared_columns(connection))

    def ids(self, query: Query) -> list[tuple[int, int]]:
        """Return store and row of every row that a query finds, in its order."""
        with self._reading() as connection:
            return [place_of(key) for key in self._ordered(connection, query)]

    def row(self, store: int, row: int) -> dict[str, Any] | None:
        """Return one row of a store; None if the index does not have it."""
        with self._reading() as connection:
            found = shown_rows(connection, [row_id(store, row)], shared_columns(connection))
            return found[0] if found else None

    def neighbours(self, query: Query, store: int, row: int) -> Neighbours:
        """Return a row's position among those that a query finds, and the rows next to it."""
        with self._reading() as connection:
            keys = self._ordered(connection, query)
        try:
            at = keys.index(row_id(store, row))
        except ValueError:
            return Neighbours(position=None, total=len(keys), previous=None, next=None)
        return Neighbours(
            position=at,
            total=len(keys),
            previous=place_of(keys[at - 1]) if at else None,
            next=place_of(keys[at + 1]) if at + 1 < len(keys) else None,
        )

    def histogram(self, column: str, query: Query, bins: int = 30) -> WordBars | NumberBins:
        """Return the distribution of a column's values over the rows that a query finds.

        Raises:
            UnknownNameError: for a column that does not exist.
            UsageError: for a column whose values cannot be counted, or an invalid number of bins.
        """
        found = lookup(BY_NAME, "column", column)
        with self._reading() as connection:
            return histograms.histogram(connection, found, query, shared_columns(connection), bins)

    def words(self, column: str, limit: int = 200) -> list[str]:
        """Return the different values of a column of words or tags, sorted.

        Raises:
            UnknownNameError: for a column that does not exist.
            UsageError: for a column of another kind.
        """
        found = lookup(BY_NAME, "column", column)
        with self._reading() as connection:
            return histograms.words(connection, found, shared_columns(connection), limit)

    def _ordered(self, connection: sqlite3.Connection, query: Query) -> array[int]:
        """Return the ids of all rows that a query finds, in its order."""
        known = self._known(connection, query)
        if known is not None:
            return known
        keys = all_in_order(connection, query, shared_columns(connection))
        key = self._key(connection, query)
        with self._lock:
            self._orders[key] = keys
            while len(self._orders) > KEPT_ORDERS:
                self._orders.popitem(last=False)
        return keys

    def _known(self, connection: sqlite3.Connection, query: Query) -> array[int] | None:
        """Return the ids of all rows that a query finds, if they are in memory."""
        key = self._key(connection, query)
        with self._lock:
            if key in self._orders:
                self._orders.move_to_end(key)
            return self._orders.get(key)

    def _key(self, connection: sqlite3.Connection, query: Query) -> tuple[Any, ...]:
        """Return the key of a query's result in memory; it differs after a change of the index."""
        (generation,) = connection.execute("SELECT generation FROM facts").fetchone()
        return query, generation, self._threads.file

    def _log(self, store: Path) -> AnnotationLog:
        return self._logs.setdefault(store, AnnotationLog(store))

    @contextlib.contextmanager
    def _reading(self) -> Iterator[sqlite3.Connection]:
        """Yield a connection that sees one unchanging state of the index.

        Raises:
            StoreError: if the index is gone or damaged.
        """
        try:
            connection = self._connection()
            connection.execute("BEGIN")
            try:
                with limited(connection, self.patience_s):
                    yield connection
            finally:
                connection.execute("ROLLBACK")
        except sqlite3.DatabaseError as error:
            raise damaged(self.path, error) from None

    def _connection(self) -> sqlite3.Connection:
        """Return this thread's connection; a new one if the file was replaced."""
        try:
            found = self.path.stat()
        except OSError:
            raise gone(self.path) from None
        file = (found.st_dev, found.st_ino)
        if getattr(self._threads, "file", None) != file:
            connection = connect(self.path, "ro")
            self._threads.connection, self._threads.file = connection, file
            with self._lock:
                self._connections.append(connection)
        mine: sqlite3.Connection = self._threads.connection
        return mine
