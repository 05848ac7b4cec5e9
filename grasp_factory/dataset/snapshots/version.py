"""A version of a store: one that a snapshot recorded, or the store as it is now."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.limits import LOG
from grasp_factory.dataset.annotations.log_file import log_file
from grasp_factory.dataset.snapshots import segments
from grasp_factory.dataset.snapshots.segments import DIGEST, ROW, decoded_rows, span
from grasp_factory.dataset.snapshots.snapshot import (
    LabelState,
    LogState,
    Snapshot,
    StoreContents,
    named_rows,
)
from grasp_factory.dataset.snapshots.snapshot_folder import SHORT, SnapshotFolder
from grasp_factory.dataset.snapshots.state_columns import StateColumns
from grasp_factory.errors import StoreError
from grasp_factory.writers.zarr.embedded import embedded_in, open_embedded
from grasp_factory.writers.zarr.header import open_store
from grasp_factory.writers.zarr.label_columns import added_columns, added_labels, label_thresholds
from grasp_factory.writers.zarr.metadata_checksum import SEAL, VALUES_SEAL

Sink = Callable[[str, str, bytes], None]
"""Takes name, kind and bytes of a segment's file."""


class Version(ABC):
    """A version of a store.

    Attributes:
        name: what it is called in messages.
        contents: what it holds.
    """

    name: str
    contents: StoreContents

    @abstractmethod
    def rows(self, k: int) -> NDArray[np.void]:
        """Return the rows of segment ``k``, (K,) of ``ROW``.

        Raises:
            StoreError: if they are damaged.
        """

    @abstractmethod
    def digests(self, k: int) -> NDArray[np.uint32]:
        """Return the CRC-32C of each array of the rows of segment ``k``, (K, A).

        Raises:
            StoreError: if they are damaged.
        """

    def _size(self, k: int) -> int:
        start, stop = span(k, self.contents.rows)
        return stop - start


class StoredVersion(Version):
    """A version that a snapshot recorded."""

    def __init__(self, folder: SnapshotFolder, name: str, snapshot: Snapshot) -> None:
        """Use a snapshot of a folder with the id ``name``."""
        self.name = f"{snapshot.store}@{name[:SHORT]}"
        self.id, self.snapshot, self.contents = name, snapshot, snapshot.contents
        self._folder = folder

    def rows(self, k: int) -> NDArray[np.void]:
        """See ``Version.rows``."""
        name, size = self.contents.segments[k], self._size(k) * ROW.itemsize
        data = self._folder.read_segment(name, "rows", size)
        return decoded_rows(data, f"{self._folder.place}: {name}")

    def digests(self, k: int) -> NDArray[np.uint32]:
        """See ``Version.digests``."""
        arrays = len(self.contents.arrays)
        size = self._size(k) * arrays * DIGEST.itemsize
        data = self._folder.read_segment(self.contents.digests[k], "crc32c", size)
        return np.frombuffer(data, DIGEST).reshape(-1, arrays)


class PresentVersion(Version):
    """A store as it is now. It must not change meanwhile."""

    def __init__(self, path: Path, sink: Sink = lambda name, kind, data: None) -> None:
        """Read the columns of the store at ``path``.

        Args:
            path: the store.
            sink: called for each segment's file.

        Raises:
            StoreMismatchError: if there is no store.
            StoreError: if it is damaged.
        """
        self.name = str(path)
        self._columns = StateColumns(path)
        self.contents = self._contents(path, sink)

    def rows(self, k: int) -> NDArray[np.void]:
        """See ``Version.rows``."""
        return self._columns.rows(*span(k, self._columns.length))

    def digests(self, k: int) -> NDArray[np.uint32]:
        """See ``Version.digests``."""
        return self._columns.digests(*span(k, self._columns.length))

    def _contents(self, path: Path, sink: Sink) -> StoreContents:
        names: dict[str, list[str]] = {"rows": [], "crc32c": []}
        counts = np.zeros(3, np.int64)
        for k in range(segments.count(self._columns.length)):
            rows = self.rows(k)
            counts += np.bincount(rows["status"], minlength=3)
            for kind, values in (("rows", rows), ("crc32c", self.digests(k))):
                data = values.tobytes()
                names[kind].append(segments.name_of(data))
                sink(names[kind][-1], kind, data)
        attributes = {k: v for k, v in self._columns.attributes.items() if k != SEAL}
        return StoreContents(
            rows=self._columns.length,
            committed=int(counts[1]),
            quarantined=int(counts[2]),
            arrays=self._columns.arrays,
            segments=tuple(names["rows"]),
            digests=tuple(names["crc32c"]),
            attributes=attributes,
            annotations=_log_state(path),
            labels=_labels(path),
            embedded=_embedded(path),
        )


def rows_sha256(path: Path) -> str:
    """Return the SHA-256 that names the rows of a store; see ``StoreContents.rows_sha256``.

    Raises:
        StoreMismatchError: if there is no store.
        StoreError: if its columns are damaged.
    """
    columns = StateColumns(path)
    spans = (span(k, columns.length) for k in range(segments.count(columns.length)))
    names = [segments.name_of(columns.rows(*rows).tobytes()) for rows in spans]
    return named_rows(columns.length, names)


def log_bytes(path: Path) -> bytes:
    """Return the complete lines of a store's annotation log; empty if there are none.

    Raises:
        StoreError: if it cannot be read.
    """
    file = log_file(path)
    try:
        data = file.read_bytes(LOG)
    except (FileNotFoundError, NotADirectoryError):
        return b""
    except OSError as error:
        raise StoreError(f"{file} cannot be read: {error.strerror}") from None
    return data[: data.rfind(b"\n") + 1]


def _log_state(path: Path) -> LogState | None:
    data = log_bytes(path)
    return LogState(bytes=len(data), sha256=hashlib.sha256(data).hexdigest()) if data else None


def _labels(path: Path) -> dict[str, LabelState]:
    columns, out = added_columns(path), {}
    for name in added_labels(path):
        array = f"labels/{name}/outcome"
        attributes = columns[array].attrs.asdict()
        thresholds = label_thresholds(f"{path}: labels/{name}", attributes)
        out[name] = LabelState(
            values_sha256=_seal_of(path, array, attributes), thresholds=thresholds
        )
    return out


def _embedded(path: Path) -> dict[str, str]:
    root, config = open_store(path, mode="r")
    return {
        name: _seal_of(path, name, open_embedded(root, name).attrs.asdict())
        for name in embedded_in(config)
    }


def _seal_of(path: Path, array: str, attributes: dict[str, Any]) -> str:
    found = attributes.get(VALUES_SEAL)
    if not isinstance(found, str):
        raise StoreError(
            f"{path} is damaged: {array} has no {VALUES_SEAL}; run grasp-factory verify"
        )
    return found
