"""Checked reading: values of committed rows are compared with their digests as they are read."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import place_of
from grasp_factory.core.schema import Field
from grasp_factory.dataset.row_codec import fixed, is_fill
from grasp_factory.dataset.row_integrity import (
    QUARANTINE_PATHS,
    digested_paths,
    is_valid_fingerprint,
    quarantine_checksum,
)
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.columns import Columns, check_lengths
from grasp_factory.writers.zarr.digests import digest
from grasp_factory.writers.zarr.layout import block_files
from grasp_factory.writers.zarr.metadata_checksum import VALUES_SEAL, is_sealed, values_digest
from grasp_factory.writers.zarr.writer import COMMITTED, MISSING, QUARANTINED

_ADVICE = "run grasp-factory verify on the store, and repair"
_UNCHECKED = (schema.CHECKSUM.path, schema.DIGESTS.path)
"""Paths of the arrays that contain the expected checksums and digests."""


def checked_arrays(
    path: Path,
    arrays: Mapping[str, StoredArray],
    fields: Mapping[str, Field],
    seed: int | None,
    *,
    has_fingerprints: bool,
) -> dict[str, StoredArray]:
    """Return the arrays of the store at ``path`` as arrays that check what they read.

    Args:
        path: the store.
        arrays: its arrays, by path.
        fields: the fields of the arrays, by path.
        seed: the seed that every recipe must have, while its index must be its row; None for a
            merged store, where neither is checked.
        has_fingerprints: whether each row must have the fingerprint of the platform that made it.

    Raises:
        StoreError: if the store has no digests, its metadata does not match its checksum, or its
            arrays have different numbers of rows.
    """
    if not digested_paths(arrays):
        raise StoreError(f"{path} has no checksums of single arrays: open it without checked=True")
    store = place_of(path)
    for name in ("", *arrays):
        if not is_sealed(store / name / "zarr.json"):
            raise StoreError(f"{path} is damaged: zarr.json of {name or 'the root'}; {_ADVICE}")
    try:
        check_lengths(path, arrays)
    except StoreError as error:
        raise StoreError(f"{error}; {_ADVICE}") from None
    order = _RowOrderCheck(path, arrays, seed, has_fingerprints=has_fingerprints)
    return {
        name: array if name in _UNCHECKED else CheckedArray(path, name, arrays, fields, order)
        for name, array in arrays.items()
    }


def checked_label(path: Path, name: str, outcome: NDArray[Any]) -> NDArray[Any]:
    """Return an added label's outcomes, (N,), after comparing them with their checksum.

    Raises:
        StoreError: if they do not match their checksum.
    """
    file = place_of(path) / "labels" / name / "outcome" / "zarr.json"
    known = parsed(file.read_bytes(DOCUMENT))["attributes"] if is_sealed(file) else {}
    if known.get(VALUES_SEAL) != values_digest(outcome):
        raise StoreError(f"{path}: labels/{name} does not match its checksum; {_ADVICE}")
    return outcome


class CheckedArray(StoredArray):
    """An array that compares committed rows with their digests as it reads them.

    ``status`` has no digest. Instead, a committed row must have a checksum, and a missing row must
    have none. The recipe and the reason of a quarantined row are compared with the row's checksum.
    All other values of a row without an episode must be the fill value.
    """

    def __init__(
        self,
        store: Path,
        path: str,
        arrays: Mapping[str, StoredArray],
        fields: Mapping[str, Field],
        order: _RowOrderCheck,
    ) -> None:
        """Wrap the array at ``path``, which is one of the store's arrays."""
        super().__init__(arrays[path].zarr)
        self._store, self._path = store, path
        self._array, self._arrays, self._field = arrays[path], arrays, fields[path]
        self._order = order
        digested = digested_paths(arrays)
        self._digest_column = digested.index(path) if path in digested else None

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """See ``StoredArray.read``; a row that does not match its digest is a StoreError."""
        values = self._array.read(start, stop)
        if stop > start:
            self._order.check(start, stop)
            self._check(values, start, stop)
        return values

    def _check(self, values: NDArray[Any], start: int, stop: int) -> None:
        status = self._arrays[schema.STATUS.path].read(start, stop)
        if self._digest_column is None:
            checksums = self._arrays[schema.CHECKSUM.path].read(start, stop)
            has_error = self._have_errors(start, stop)
            for k in range(stop - start):
                if not self._agrees(
                    start + k, int(status[k]), str(checksums[k]), has_error=bool(has_error[k])
                ):
                    self._refuse(start + k)
                if self._path == schema.FINGERPRINT.path:
                    self._check_fingerprint(start + k, int(status[k]), str(values[k]))
            return
        stored = self._arrays[schema.DIGESTS.path].read(start, stop)[:, self._digest_column]
        ends = None
        if self._field.length_column:
            ends = self._arrays[self._field.length_column].read(start, stop)
        for k in range(stop - start):
            if status[k] != COMMITTED:
                is_valid = self._is_without_episode(start + k, int(status[k]), values[k])
            else:
                end = None if ends is None else max(int(ends[k]), 0)
                value = fixed(values[k] if ends is None else values[k][:end])
                is_valid = digest(value) == stored[k]
            if not is_valid:
                self._refuse(start + k)

    def _check_fingerprint(self, row: int, status: int, text: str) -> None:
        required = status != MISSING and self._order.has_fingerprints
        if not is_valid_fingerprint(text, required=required) and not self._is_unfinished(row):
            self._refuse(row)

    def _is_without_episode(self, row: int, status: int, value: Any) -> bool:
        """Return whether a value is valid for a row without an episode.

        It must be the fill value, or match the checksum of a quarantined row. A missing row may
        have any value while its block is being written.
        """
        if status == MISSING and self._is_unfinished(row):
            return True
        if status == QUARANTINED and self._path in QUARANTINE_PATHS:
            stored = str(self._arrays[schema.CHECKSUM.path].read(row, row + 1)[0])
            return stored == self._quarantined(row)
        return is_fill(fixed(value), self._field.fill)

    def _agrees(self, row: int, status: int, stored: str, *, has_error: bool) -> bool:
        """Return whether a row's checksum and error agree with its status."""
        if status == COMMITTED:
            return bool(stored) and not has_error
        if status == QUARANTINED:
            return stored == self._quarantined(row)
        return status == MISSING and (not stored or self._is_unfinished(row))

    def _have_errors(self, start: int, stop: int) -> NDArray[np.bool_]:
        """Return which rows have a reason in ``error``; the texts of one file are in memory."""
        texts = self._arrays[schema.ERROR.path]
        size = texts.zarr.chunks[0]
        edges = [start, *range((start // size + 1) * size, stop, size), stop]
        return np.concatenate([texts.read(*edge) != "" for edge in pairwise(edges)])

    def _quarantined(self, row: int) -> str:
        """Return the checksum that a quarantined row must have."""
        return quarantine_checksum(
            {p: fixed(self._arrays[p].read(row, row + 1)[0]) for p in QUARANTINE_PATHS}
        )

    def _is_unfinished(self, row: int) -> bool:
        """Return whether a row's block is unfinished: its marker is missing or being replaced."""
        block = row // self._arrays[schema.STATUS.path].zarr.chunks[0]
        marker = block_files(place_of(self._store), schema.STATUS, block, range(0))[0]
        return marker.partial.exists() or not marker.exists()

    def _refuse(self, row: int) -> None:
        what = f"episode {row} is damaged: {self._path} does not match its checksum"
        raise StoreError(f"{self._store}: {what}; {_ADVICE}")


class _RowOrderCheck:
    """Checks that each row has the recipe of its index; a complete block is checked only once."""

    def __init__(
        self,
        store: Path,
        arrays: Mapping[str, StoredArray],
        seed: int | None,
        *,
        has_fingerprints: bool,
    ) -> None:
        self._store, self._seed = store, seed
        self.has_fingerprints = has_fingerprints
        of = (schema.STATUS.path, "episodes/index", "episodes/seed")
        self._arrays = [arrays[path] for path in of if path in arrays]
        self._rows = arrays[schema.STATUS.path].zarr.chunks[0]
        self._known: set[int] = set()

    def check(self, start: int, stop: int) -> None:
        """Check the blocks of rows ``start`` to ``stop`` - 1.

        Raises:
            StoreError: naming a row that holds another row's episode.
        """
        if self._seed is None:
            return
        for block in set(range(start // self._rows, -(-stop // self._rows))) - self._known:
            first = block * self._rows
            last = min(first + self._rows, self._arrays[0].zarr.shape[0])
            status, index, seed = (array.read(first, last) for array in self._arrays)
            is_other = (index != np.arange(first, last)) | (seed != self._seed)
            for k in np.flatnonzero((status != MISSING) & is_other)[:1]:
                what = f"row {first + k} holds episode {index[k]} of seed {seed[k]}"
                raise StoreError(f"{self._store} is damaged: {what}; {_ADVICE}")
            if (status != MISSING).all():
                self._known.add(block)


class CheckedColumns:
    """Whole columns, read from the blocks' files, because packed segments have no row digests."""

    def __init__(self, columns: Columns, arrays: Mapping[str, StoredArray]) -> None:
        """Use a store's columns, and its checked arrays by path."""
        self._columns, self._arrays = columns, arrays
        self.names, self.length = columns.names, columns.length
        self.block_count = columns.block_count

    def read(self, *names: str) -> dict[str, NDArray[Any]]:
        """Return whole columns by name, each (N, ...); see ``Columns.read``.

        Raises:
            StoreError: if one is damaged.
        """
        out = {name: self._columns.filled(name) for name in names}
        text = self._columns.text_budget()
        for start, stop in map(self._columns.rows, np.flatnonzero(self._columns.blocks()).tolist()):
            for name in names:
                out[name][start:stop] = text.count(self._columns.read_rows(name, start, stop))
        return out

    def gather(self, rows: NDArray[np.int64], *names: str) -> dict[str, NDArray[Any]]:
        """Return some rows of columns; see ``Columns.gather``.

        Raises:
            StoreError: if one is damaged.
        """
        return self._columns.gather(rows, *names)
