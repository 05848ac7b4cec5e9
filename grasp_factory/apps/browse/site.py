"""The state that all parts of the page share."""

from __future__ import annotations

import contextlib
import threading
import time
from dataclasses import dataclass, field
from typing import Any, Protocol

from flask import abort, request

from grasp_factory.apps.browse.clips import Clips
from grasp_factory.apps.browse.guard import Guard
from grasp_factory.apps.browse.open_stores import OpenStore, OpenStores
from grasp_factory.apps.browse.thumbnail_cache import Thumbnails
from grasp_factory.dataset.index import Index, build
from grasp_factory.errors import GraspFactoryError, StoreError

LOOK_AGAIN_S = 3.0
"""Seconds for which the index counts as up to date with the stores."""


class Live(Protocol):
    """A run that makes episodes while the page is open."""

    def snapshot(self) -> dict[str, Any]:
        """Return its state as plain values."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Site:
    """An index, its stores, and the guard that decides who may write to them."""

    index: Index
    guard: Guard
    stores: OpenStores
    thumbnails: Thumbnails
    clips: Clips
    live: Live | None
    freshness: Freshness = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "freshness", Freshness(self.index))

    def store(self, number: int) -> OpenStore:
        """Return a store of the index, or abort with 404.

        Raises:
            StoreMismatchError, StoreError: if it cannot be opened.
        """
        self.check_store(number)
        return self.stores.open(number)

    def check_store(self, number: int) -> None:
        """Abort with 404 for a number that no store has."""
        if self.stores.path(number) is None:
            abort(404, f"there is no store {number} here")

    def episode(self, number: int, row: int) -> tuple[OpenStore, str]:
        """Return the store of a committed episode and its ``version``, or abort with 404.

        Raises:
            StoreMismatchError, StoreError: if the store is damaged.
        """
        opened = self.store(number)
        try:
            opened.dataset.value(row, "outcome")
            return opened, opened.version(row)
        except IndexError as error:
            abort(404, str(error))
        except StoreError as error:
            indexed = self.index.row(number, row)
            if indexed is None or indexed["status"] != "committed":
                abort(404, str(error))
            raise

    def version(self, number: int, row: int) -> str:
        """Return the version of a row; empty if its store cannot be read."""
        try:
            return self.store(number).version(row)
        except GraspFactoryError:
            return ""

    def row(self, number: int, row: int) -> dict[str, Any] | None:
        """Return a row of the index; one that a run has made since the last look is read now."""
        found = self.index.row(number, row)
        if found is None and self._is_made(number, row):
            self.freshness.now()
            found = self.index.row(number, row)
        return found

    def _is_made(self, number: int, row: int) -> bool:
        with contextlib.suppress(IndexError, StoreError):
            self.store(number).dataset.spec(row)
            return True
        return False


class Freshness:
    """Updates the index from its stores: for each new page, and every few seconds after that.

    If a store cannot be read at the moment, for example because it is being made again, the page
    shows the previous content of the index.
    """

    def __init__(self, index: Index) -> None:
        self._index = index
        self._stores = [store.path for store in index.stores]
        self._lock = threading.Lock()
        self._looked = float("-inf")

    def now(self) -> str:
        """Update the index; return the error if this fails, else an empty text."""
        with self._lock:
            return self._refresh()

    def soon(self) -> None:
        """Update the index, unless this was done recently or is being done now."""
        if time.monotonic() - self._looked < LOOK_AGAIN_S or not self._lock.acquire(blocking=False):
            return
        try:
            self._refresh()
        finally:
            self._lock.release()

    def restore(self) -> None:
        """Build the index again if it was deleted; other requests wait until it is built.

        Raises:
            UsageError: if it cannot be written.
            StoreError: if a store cannot be read.
        """
        if not request.path.startswith("/api/") or self._index.path.exists():
            return
        with self._lock:
            if not self._index.path.exists():
                build(self._stores, self._index.path)

    def _refresh(self) -> str:
        try:
            self._index.refresh()
        except GraspFactoryError as error:
            return str(error)
        finally:
            self._looked = time.monotonic()
        return ""
