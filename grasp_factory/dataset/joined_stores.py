"""Several stores of one kind as one: their rows follow one another, nothing is copied."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.config_difference import first_difference
from grasp_factory.core.object_storage.address import real_path
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.annotations import Annotation, AnnotationLog
from grasp_factory.dataset.checked_reader import CheckedColumns
from grasp_factory.dataset.opened_store import OpenedStore, opened
from grasp_factory.errors import UsageError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.columns import Columns

_APART = ("seed", "block_size")
"""Keys of the config in which the stores may differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenedStores:
    """Stores that are read as one.

    The config and the attributes of ``store`` are those of the first. It has the arrays that all of
    them have.
    """

    name: Path
    """Path of the store, or a text about several, for messages."""
    store: OpenedStore
    columns: Columns | CheckedColumns | JoinedColumns
    annotations: AnnotationLog | JoinedAnnotations
    starts: NDArray[np.int64]
    """The first row of each store, and the number of all rows, (K + 1,)."""


def opened_together(paths: Sequence[Path], *, checked: bool) -> OpenedStores:
    """Open stores of one kind for reading.

    Args:
        paths: their paths.
        checked: see ``opened``.

    Raises:
        StoreMismatchError: if there is no store, or it has a newer version.
        StoreError: if one is damaged.
        UsageError: if they cannot be read as one.
    """
    stores = [opened(path, checked=checked) for path in paths]
    _check_alike(paths, stores)
    columns = [
        _columns(path, store, checked=checked) for path, store in zip(paths, stores, strict=True)
    ]
    logs = [AnnotationLog(path) for path in paths]
    lengths = [store.arrays[schema.STATUS.path].zarr.shape[0] for store in stores]
    starts = np.cumsum([0, *lengths], dtype=np.int64)
    if len(paths) == 1:
        return OpenedStores(
            name=paths[0], store=stores[0], columns=columns[0], annotations=logs[0], starts=starts
        )
    return OpenedStores(
        name=Path(joined_name(paths)),
        store=_joined(stores, starts),
        columns=JoinedColumns(columns, starts),
        annotations=JoinedAnnotations(logs, starts),
        starts=starts,
    )


def joined_name(paths: Sequence[Path]) -> str:
    """Return the path of a store, or of the first of several and their number, for messages."""
    return f"{paths[0]} and {len(paths) - 1} more" if len(paths) > 1 else str(paths[0])


class JoinedArray(StoredArray):
    """An array whose rows are those of several arrays, one after another."""

    def __init__(self, parts: Sequence[StoredArray], starts: NDArray[np.int64]) -> None:
        """Join arrays.

        Args:
            parts: K arrays, which differ in the number of rows alone.
            starts: the first row of each, and the number of all rows, (K + 1,).
        """
        super().__init__(_with_rows(parts[0].zarr, int(starts[-1])))
        self._parts, self._starts = parts, starts

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """See ``StoredArray.read``."""
        found = [
            part.read(max(start - first, 0), min(stop, last) - first)
            for part, first, last in zip(
                self._parts, self._starts[:-1].tolist(), self._starts[1:].tolist(), strict=True
            )
            if start < last and stop > first
        ]
        return found[0] if len(found) == 1 else np.concatenate([self._parts[0].read(0, 0), *found])

    def read_frames(self, rows: Sequence[int], frame: int) -> NDArray[Any]:
        """See ``StoredArray.read_frames``."""
        return spread(
            np.asarray(rows, np.int64),
            self._starts,
            lambda k, mine: self._parts[k].read_frames(mine.tolist(), frame),
            np.empty((len(rows), *self.zarr.shape[2:]), self.zarr.dtype),
        )

    def gather(self, rows: NDArray[np.int64], block_size: int) -> NDArray[Any]:
        """See ``StoredArray.gather``."""
        out = np.empty((len(rows), *self.zarr.shape[1:]), self.zarr.dtype)
        return spread(
            rows, self._starts, lambda k, mine: self._parts[k].gather(mine, block_size), out
        )


class JoinedColumns:
    """The columns of several stores, one after another."""

    def __init__(
        self, parts: Sequence[Columns | CheckedColumns], starts: NDArray[np.int64]
    ) -> None:
        """Join columns; see ``JoinedArray``. The names are those that all stores have."""
        self._parts, self._starts = parts, starts
        self.length = int(starts[-1])
        self.names = [
            name for name in parts[0].names if all(name in part.names for part in parts[1:])
        ]
        self.block_count = sum(part.block_count for part in parts)

    def read(self, *names: str) -> dict[str, NDArray[Any]]:
        """See ``Columns.read``."""
        read = [part.read(*names) for part in self._parts]
        return {name: np.concatenate([values[name] for values in read]) for name in names}

    def gather(self, rows: NDArray[np.int64], *names: str) -> dict[str, NDArray[Any]]:
        """See ``Columns.gather``."""
        out: dict[str, NDArray[Any]] = {}
        for k, places in places_by_store(rows, self._starts):
            found = self._parts[k].gather(rows[places] - self._starts[k], *names)
            for name, values in found.items():
                whole = np.empty((len(rows), *values.shape[1:]), values.dtype)
                out.setdefault(name, whole)[places] = values
        return out or self._parts[0].gather(rows, *names)


class JoinedAnnotations:
    """The annotations of several stores, by the rows of all."""

    def __init__(self, logs: Sequence[AnnotationLog], starts: NDArray[np.int64]) -> None:
        """Join logs; see ``JoinedArray``."""
        self._logs, self._starts = logs, starts

    def annotations(self) -> dict[int, Annotation]:
        """See ``AnnotationLog.annotations``."""
        pairs = zip(self._logs, self._starts.tolist(), strict=False)
        return {first + k: said for log, first in pairs for k, said in log.annotations().items()}


def _check_alike(paths: Sequence[Path], stores: Sequence[OpenedStore]) -> None:
    """Check that stores can be read as one.

    Raises:
        UsageError: for none, for one that is named twice, or for configs that differ in more than
            the seed and the size of blocks.
    """
    if not paths:
        raise UsageError("no stores: name one or more")
    places = list(map(real_path, paths))
    for k, place in enumerate(places):
        if place in places[:k]:
            raise UsageError(f"{paths[k]}: the store is named twice; name each store once")
    first = _plain(stores[0])
    for path, store in zip(paths[1:], stores[1:], strict=True):
        different = first_difference(first, _plain(store))
        if different:
            raise UsageError(
                f"{path} and {paths[0]} are of different kinds: {different}; valid: stores of one"
                f" config, but for {' and '.join(_APART)}"
            )


def _joined(stores: Sequence[OpenedStore], starts: NDArray[np.int64]) -> OpenedStore:
    first = stores[0]
    common = [path for path in first.arrays if all(path in store.arrays for store in stores)]
    arrays: Mapping[str, StoredArray] = {
        path: JoinedArray([store.arrays[path] for store in stores], starts) for path in common
    }
    fields = {path: field for path, field in first.fields.items() if path in arrays}
    return replace(first, arrays=arrays, fields=fields)


def _columns(path: Path, store: OpenedStore, *, checked: bool) -> Columns | CheckedColumns:
    columns = Columns(path, store.config, store.arrays)
    return CheckedColumns(columns, store.arrays) if checked else columns


def places_by_store(
    rows: NDArray[np.int64], starts: NDArray[np.int64]
) -> list[tuple[int, NDArray[np.intp]]]:
    """Return the number of each store that some rows (K,) are in, and which of the K they are."""
    stores = np.searchsorted(starts, rows, side="right") - 1
    return [(int(k), np.flatnonzero(stores == k)) for k in np.unique(stores)]


def spread(
    rows: NDArray[np.int64],
    starts: NDArray[np.int64],
    read: Callable[[int, NDArray[np.int64]], NDArray[Any]],
    out: NDArray[Any],
) -> NDArray[Any]:
    """Fill ``out`` with what a function returns for the number of a store, and rows in it."""
    for k, places in places_by_store(rows, starts):
        out[places] = read(k, rows[places] - starts[k])
    return out


def _plain(store: OpenedStore) -> dict[str, Any]:
    plain: dict[str, Any] = to_plain(store.config)
    return {key: value for key, value in plain.items() if key not in _APART}


def _with_rows(array: zarr.Array[Any], rows: int) -> zarr.Array[Any]:
    """Return an array like another one, of so many rows, of which only the facts are used."""
    metadata = copy.copy(array.metadata)
    object.__setattr__(metadata, "shape", (rows, *array.shape[1:]))
    return zarr.Array(zarr.AsyncArray(metadata=metadata, store_path=array.store_path))
