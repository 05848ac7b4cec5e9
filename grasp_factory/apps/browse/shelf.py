"""The stores that the page shows, opened for reading, and anew when they have changed."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.schema import STATUS
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import IndexedStore

Stamp = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenStore:
    """A store, opened. Reading from several threads at once is safe: no file stays open."""

    dataset: Dataset
    arrays: Mapping[str, Any]
    """Every Zarr array by its path, for what ``Dataset`` reads only as a part of an episode."""
    log: AnnotationLog


class Shelf:
    """Opens each store once, and again when its length or anything else of its header changes.

    Rows that a run adds to a store of fixed length are seen without: each is read from its files.
    """

    def __init__(self, stores: Sequence[IndexedStore]) -> None:
        self._paths = {store.id: Path(store.path) for store in stores}
        self._open: dict[int, tuple[Stamp, OpenStore]] = {}
        self._lock = threading.Lock()

    def path(self, store: int) -> Path | None:
        """Return where a store of the index is; None if the index has none of that number."""
        return self._paths.get(store)

    def open(self, store: int) -> OpenStore:
        """Return a store that there is, opened.

        Raises:
            StoreMismatchError, StoreError: as ``Dataset.open`` does.
        """
        path = self._paths[store]
        stamp = _stamp(path)
        with self._lock:
            if store not in self._open or self._open[store][0] != stamp:
                dataset = Dataset.open(path)
                opened = OpenStore(
                    dataset=dataset, arrays=dataset.arrays(), log=AnnotationLog(path)
                )
                self._open[store] = (stamp, opened)
            return self._open[store][1]


def _stamp(path: Path) -> Stamp:
    """Return what changes with a store's header: with its length, or when it is made anew."""
    found = []
    for file in (path / "zarr.json", path / STATUS.path / "zarr.json"):
        try:
            state = file.stat()
        except OSError:
            found.append((0, 0, 0))
        else:
            found.append((state.st_ino, state.st_size, state.st_mtime_ns))
    return tuple(found)
