"""Opening an up-to-date index, from the paths of a command line."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

from grasp_factory.core.cache import touch
from grasp_factory.dataset.index.building import build, default_path, places
from grasp_factory.dataset.index.database import (
    VERSION,
    DamagedIndexError,
    connect,
    damaged,
    version_of,
)
from grasp_factory.dataset.index.handle import Index
from grasp_factory.dataset.index.made_here import changing, remove_unused, token_of
from grasp_factory.errors import UsageError


def fresh(
    paths: Sequence[Path],
    index: Path | None = None,
    on_start: Callable[[int], None] = lambda rows: None,
    on_row: Callable[[int], None] = lambda row: None,
) -> Index:
    """Open the index of some stores and update it; it is built if there is none.

    Args:
        paths: Stores, or one index file.
        index: The path of the index. None for the default, in the cache.
        on_start: Called with the number of rows if the index is built; see ``build``.
        on_row: Called after each of these rows.

    Raises:
        StoreMismatchError: if a path is neither a store nor an index.
        StoreError: if a store is gone or damaged.
        UsageError: if the index cannot be written, or was not built here, or if its path is another
            file or the index of other stores.
    """
    stores = places(paths)
    if len(stores) == 1 and stores[0].is_file():
        if index is not None:
            raise UsageError(f"{paths[0]} is a file: --index goes with stores only")
        return _of_file(stores[0], on_start, on_row)
    place = default_path(stores) if index is None else index
    opened = _opened(place, stores, is_named=index is not None)
    if opened is None:
        build(stores, place, on_start, on_row)
        opened = Index(place)
    if index is None:
        touch(place)
        remove_unused(place.parent)
    return opened


def _opened(place: Path, stores: Sequence[Path], *, is_named: bool) -> Index | None:
    """Return the index at a place, up to date; None if it has to be built."""
    version = version_of(place)
    if version is None:
        return None
    try:
        is_believed = _is_made_here(place)
    except DamagedIndexError:
        return None
    if not is_believed and is_named:
        raise _not_made_here(place)
    if not is_believed or version != VERSION:
        return None
    opened = Index(place)
    try:
        there = {store.path for store in opened.stores}
        if there == set(stores):
            opened.refresh()
            return opened
    except DamagedIndexError:
        there = set(stores)  # an index is derived from its stores: build it again
    except BaseException:
        opened.close()
        raise
    opened.close()
    if is_named and there != set(stores):
        names = ", ".join(map(str, sorted(there)))
        raise UsageError(
            f"{place} is the index of {names}; give it in place of the stores, or name another"
            f" file; grasp-factory index ... --out {place} builds it again"
        )
    return None


def _of_file(file: Path, on_start: Callable[[int], None], on_row: Callable[[int], None]) -> Index:
    version = version_of(file)
    if not _is_made_here(file):
        raise _not_made_here(file)
    if version != VERSION:
        raise UsageError(
            f"index {file} was made by another version of grasp-factory; build it again:"
            f" grasp-factory index STORE... --out {file}"
        )
    opened = Index(file)
    try:
        opened.refresh()
    except BaseException:
        opened.close()
        raise
    return opened


def _is_made_here(place: Path) -> bool:
    """Return whether the index was built by this user on this machine.

    Raises:
        StoreError: if it was, and cannot be read.
    """
    token = token_of(place)
    if token is None:
        return False
    kept, is_whole = _facts(place)
    if kept == token and not is_whole:
        with contextlib.suppress(OSError), changing(place):  # another process may be changing it
            is_whole = _facts(place)[1]
        if not is_whole:
            raise DamagedIndexError(f"index {place} is not complete: a change of it was cut short")
    return bool(kept == token)


def _facts(place: Path) -> tuple[str, int]:
    try:
        with contextlib.closing(connect(place, "ro")) as connection:
            token, is_whole = connection.execute("SELECT token, is_whole FROM facts").fetchone()
    except sqlite3.DatabaseError as error:
        raise damaged(place, error) from None
    return token, is_whole


def _not_made_here(place: Path) -> UsageError:
    return UsageError(
        f"index {place} was not built by you on this machine, so it may not tell the truth about"
        f" its stores; build it again: grasp-factory index STORE... --out {place}"
    )
