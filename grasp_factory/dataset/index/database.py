"""The index's file: its tables, and how it is opened, recognised and replaced."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import struct
import time
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from grasp_factory.core.atomic_file import move_into_place
from grasp_factory.core.cache import VARIABLE
from grasp_factory.core.locked_file import has_name, open_locked
from grasp_factory.core.regular_file import check_regular, open_regular
from grasp_factory.dataset.index.columns import BY_NAME, OF_ROWS
from grasp_factory.dataset.index.made_here import (
    changing,
    new_token,
    remember,
    remove_side_files,
)
from grasp_factory.errors import StoreError, UsageError

APPLICATION_ID = 0x47464958
"""Marks SQLite files that are an index of grasp-factory: ``GFIX``."""
TABLES = 3
"""Version of the tables, apart from the columns of episodes."""
_COLUMNS = [(name, BY_NAME[name].kind) for name in OF_ROWS]
VERSION = zlib.crc32(repr((TABLES, _COLUMNS)).encode()) >> 1
"""Stored in each index. One with other tables or columns is built again."""
WAIT_S = 60.0
"""Seconds to wait for another process that writes."""
ROW_BITS = 40
"""A row's id is its store's number, shifted left by this, plus the row's number."""
_TYPES = {"number": "REAL", "whole": "INTEGER", "bool": "INTEGER"}
_STEPS = 10_000
"""Instructions of SQLite's virtual machine between two checks of the time: at most 1 ms."""
_HEADER = 100
"""Bytes of an SQLite file's header."""


class DamagedIndexError(StoreError):
    """An index that cannot be read; it can be built again."""


def row_id(store: int, row: int) -> int:
    """Return the id of a row of a store."""
    return store << ROW_BITS | row


def place_of(key: int) -> tuple[int, int]:
    """Return the store and the row of an id."""
    return key >> ROW_BITS, key & ((1 << ROW_BITS) - 1)


def quoted(column: str) -> str:
    """Return a column's name for SQL.

    Raises:
        KeyError: for anything but a column of the index.
    """
    return f'"{BY_NAME[column].name}"'


def version_of(file: Path) -> int | None:
    """Return the version of an index; None if there is no file.

    Raises:
        UsageError: if the file is no index of grasp-factory.
    """
    try:
        with os.fdopen(open_regular(file.resolve(), os.O_RDONLY), "rb") as opened:
            header = opened.read(_HEADER)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise UsageError(f"index {file} cannot be read: {error.strerror}") from None
    if len(header) == _HEADER and header.startswith(b"SQLite format 3\0"):
        version, application = struct.unpack_from(">i", header, 60), header[68:72]
        if application == APPLICATION_ID.to_bytes(4):
            return int(version[0])
    raise UsageError(
        f"{file} is no index of grasp-factory: nothing is written to it; name another file"
    )


def connect(file: Path, mode: str) -> sqlite3.Connection:
    """Open a database; ``mode`` is ro, rw or rwc. Transactions are begun explicitly."""
    uri = f"{file.absolute().as_uri()}?mode={mode}"
    connection = sqlite3.connect(
        uri,
        uri=True,
        timeout=WAIT_S,
        isolation_level=None,
        check_same_thread=False,  # each thread has its own, but another one may close it
    )
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA journal_mode = MEMORY")  # no file beside it
        connection.execute("PRAGMA cache_size = -65536")
    except BaseException:
        connection.close()
        raise
    return connection


@contextlib.contextmanager
def limited(connection: sqlite3.Connection, seconds: float) -> Iterator[None]:
    """Limit the time of the statements in a block, in seconds.

    Raises:
        StoreError: if they take longer.
    """
    deadline = time.monotonic() + seconds
    connection.set_progress_handler(lambda: time.monotonic() > deadline, _STEPS)
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode != sqlite3.SQLITE_INTERRUPT:
            raise
        what = "the query takes too long: ask with fewer conditions, or fewer columns to sort by"
        raise StoreError(f"{what}; it was stopped after {seconds:g} s") from None
    finally:
        connection.set_progress_handler(None, _STEPS)


def _connect_writing(file: Path) -> sqlite3.Connection:
    try:
        return connect(file, "rw")
    except sqlite3.OperationalError as error:
        raise cannot_write(file, str(error)) from None


@contextlib.contextmanager
def writing(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection in a transaction, committed at the end; readers are not blocked.

    Raises:
        UsageError: if the file cannot be written.
    """
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(changing(file))
        except OSError as error:
            raise cannot_write(file, error.strerror or str(error)) from None
        connection = stack.enter_context(contextlib.closing(_connect_writing(file)))
        # A transaction that spills from its cache locks readers out from then on.
        connection.execute("PRAGMA cache_spill = OFF")
        try:
            connection.execute("UPDATE facts SET is_whole = 0")
            connection.execute("BEGIN IMMEDIATE")
            yield connection
            connection.execute("UPDATE facts SET generation = generation + 1")
            connection.execute("COMMIT")
            connection.execute("UPDATE facts SET is_whole = 1")
        except sqlite3.OperationalError as error:
            raise cannot_write(file, str(error)) from None
        except sqlite3.DatabaseError as error:
            raise damaged(file, error) from None


@contextlib.contextmanager
def built_aside(file: Path) -> Iterator[sqlite3.Connection]:
    """Yield a connection to a new database, which replaces ``file`` at the end.

    A process that builds the same index at the same time waits.

    Raises:
        UsageError: if it cannot be written, or the file is no index.
    """
    version_of(file)
    place = file.with_name(f".{file.name}.building")
    with contextlib.ExitStack() as stack:
        try:
            check = partial(check_regular, file=place, is_written=True)
            descriptor = open_locked(place, wait=True, check=check)
            stack.callback(os.close, descriptor)
            stack.callback(_remove_own, place, descriptor)
            os.ftruncate(descriptor, 0)  # remove what a killed process left
            remove_side_files(place)
            connection = stack.enter_context(contextlib.closing(connect(place, "rw")))
            for pragma in ("journal_mode = OFF", "synchronous = OFF", "locking_mode = EXCLUSIVE"):
                connection.execute(f"PRAGMA {pragma}")
            connection.execute("PRAGMA cache_size = -200000")
            connection.execute("BEGIN")
            token = new_token()
            _create_tables(connection, token)
            yield connection
            _create_indices(connection)
            connection.execute("COMMIT")
            connection.close()
            remember(place, token)  # before it has its name, by which others find it
            remove_side_files(file)
            move_into_place(place, file, durable=True)
        except OSError as error:
            raise cannot_write(file, error.strerror or str(error)) from None
        except sqlite3.OperationalError as error:
            raise cannot_write(file, str(error)) from None


def cannot_write(file: Path, why: str) -> UsageError:
    """Return the error to raise for an index that cannot be written."""
    where = "name one that can be: --out FILE of index, --index FILE of other commands"
    more = f"or set {VARIABLE} to a writable directory"
    return UsageError(f"index {file} cannot be written: {why}; {where}, {more}")


def damaged(file: Path, error: sqlite3.DatabaseError) -> StoreError:
    """Return the error to raise for an index that cannot be read."""
    if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
        return StoreError(f"index {file} is locked by another process: try again later")
    return DamagedIndexError(f"index {file} is damaged: {error}; delete it: it is built again")


def gone(file: Path) -> StoreError:
    """Return the error to raise for an index that has disappeared."""
    what = f"there is no index at {file} any more"
    return StoreError(f"{what}: grasp-factory index STORE... --out {file} builds it again")


def _remove_own(place: Path, descriptor: int) -> None:
    """Remove a locked file, unless it was renamed: then another file may have its name."""
    if has_name(descriptor, place):
        place.unlink()


def _create_tables(connection: sqlite3.Connection, token: str) -> None:
    columns = ", ".join(
        f"{quoted(name)} {_TYPES.get(BY_NAME[name].kind, 'TEXT')}" for name in OF_ROWS
    )
    for statement in (
        f"PRAGMA application_id = {APPLICATION_ID}",
        f"PRAGMA user_version = {VERSION}",
        "CREATE TABLE facts (generation INTEGER NOT NULL, token TEXT NOT NULL, is_whole INTEGER)",
        f"INSERT INTO facts VALUES (1, '{token}', 1)",
        "CREATE TABLE stores (id INTEGER PRIMARY KEY, path TEXT NOT NULL, root TEXT, state TEXT,"
        " annotations TEXT, scenario TEXT, task_type TEXT, extracted_path TEXT, sensor_setup TEXT)",
        "CREATE TABLE blocks (store INTEGER, block INTEGER, marker TEXT,"
        " PRIMARY KEY (store, block)) WITHOUT ROWID",
        "CREATE TABLE row_tags (tag TEXT, id INTEGER, PRIMARY KEY (tag, id)) WITHOUT ROWID",
        "CREATE TABLE folded (text TEXT PRIMARY KEY, folded TEXT) WITHOUT ROWID",
        f"CREATE TABLE episodes (id INTEGER PRIMARY KEY, {columns})",
    ):
        connection.execute(statement)


def _create_indices(connection: sqlite3.Connection) -> None:
    for name in OF_ROWS:
        connection.execute(f'CREATE INDEX "by_{name}" ON episodes ({quoted(name)})')
    connection.execute("CREATE INDEX tags_of_row ON row_tags (id)")
