"""The stores that the page shows, opened for reading, and opened again when they change."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grasp_factory.core.object_storage.address import store_path
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.schema import STATUS
from grasp_factory.dataset.annotations import AnnotationLog
from grasp_factory.dataset.block_version import block_version
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.index import IndexedStore

Stamp = tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenStore:
    """An open store. Several threads may read from it at once: no file handle is kept."""

    place: Place
    dataset: Dataset
    arrays: Mapping[str, Any]
    """Every Zarr array by its path, for data that ``Dataset`` reads only as part of an episode."""
    log: AnnotationLog

    def version(self, row: int) -> str:
        """Return a text that changes when a row's files are written again; empty if it has none."""
        try:
            return block_version(self.place, row // self.dataset.config.block_size)
        except OSError:
            return ""


class OpenStores:
    """Opens each store once, and again when its header changes, for example its length.

    A store of fixed length is not opened again for rows that a run adds: each is read from files.
    """

    def __init__(self, stores: Sequence[IndexedStore]) -> None:
        self._paths = {store.id: store_path(store.path) for store in stores}
        self._open: dict[int, tuple[Stamp, OpenStore]] = {}
        self._lock = threading.Lock()

    def path(self, store: int) -> Path | None:
        """Return the path of a store of the index; None if no store has that number."""
        return self._paths.get(store)

    def open(self, store: int) -> OpenStore:
        """Return a store of the index, opened for reading.

        Raises:
            StoreMismatchError, StoreError: as ``Dataset`` does.
        """
        path = self._paths[store]
        stamp = _stamp(path)
        with self._lock:
            if store not in self._open or self._open[store][0] != stamp:
                dataset = Dataset(path)
                opened = OpenStore(
                    place=place_of(path),
                    dataset=dataset,
                    arrays=dataset.arrays(),
                    log=AnnotationLog(path),
                )
                self._open[store] = (stamp, opened)
            return self._open[store][1]


def _stamp(path: Path) -> Stamp:
    """Return inode, size and time of the header files, which change with the store's header."""
    found = []
    for name in ("zarr.json", f"{STATUS.path}/zarr.json"):
        try:
            state = (place_of(path) / name).stat()
        except OSError:
            found.append((0, 0, 0))
        else:
            found.append((state.st_ino, state.st_size, state.st_ctime_ns))
    return tuple(found)
