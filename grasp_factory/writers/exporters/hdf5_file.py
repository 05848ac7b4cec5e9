"""A new HDF5 file on a disk that may fail.

The HDF5 library ends the process with a segmentation fault if the disk is full while it closes a
file (seen with HDF5 2.0 in h5py 3.16). So it writes through a file object that does not fail: what
the disk refuses stays in memory, and ``check`` raises the error.
"""

from __future__ import annotations

import io
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py


class NewHdf5File:
    """An HDF5 file that is written; a context manager that closes it.

    Attributes:
        file: the file, open for writing.
    """

    def __init__(self, path: Path) -> None:
        """Create the file.

        Raises:
            OSError: if it cannot be created.
        """
        self._disk = _Disk(path)
        self.file = h5py.File(self._disk, "w")

    def check(self) -> None:
        """Check that the disk took everything so far. Call it often: the rest is in memory.

        Raises:
            OSError: if it did not.
        """
        if self._disk.error:
            raise self._disk.error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        try:
            self.file.close()
        finally:
            self._disk.close()
        if error is None:
            self.check()


def add_next_view(group: h5py.Group, name: str, dataset: h5py.Dataset) -> None:
    """Add a view of a dataset (K, ...) whose row k is row k + 1, or K - 1 at the end.

    h5py's ``create_virtual_dataset`` stores the time, so that bytes would not repeat.
    """
    count, shape = len(dataset), dataset.shape[1:]
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    for to, start, rows in ((0, 1, count - 1), (count - 1, count - 1, 1)):
        if rows:
            view, source = dataset.id.get_space(), dataset.id.get_space()
            view.select_hyperslab((to, *(0 for _ in shape)), (rows, *shape))
            source.select_hyperslab((start, *(0 for _ in shape)), (rows, *shape))
            properties.set_virtual(view, b".", dataset.name.encode(), source)
    kind, space = dataset.id.get_type(), dataset.id.get_space()
    h5py.h5d.create(group.id, name.encode(), kind, space, properties)


class _Disk(io.RawIOBase):
    """A file object for HDF5, whose reads and writes succeed; the first failure is kept."""

    def __init__(self, path: Path) -> None:
        self._raw: io.FileIO = path.open("w+b", buffering=0)
        self._at = 0
        self._refused: list[tuple[int, bytes]] = []
        """Positions, and the bytes that the disk did not take."""
        self.error: OSError | None = None

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Move to a position, as HDF5 does before it reads and writes; return the position."""
        is_end = whence == io.SEEK_END
        ends = [at + len(data) for at, data in self._refused] if is_end else []
        self._at = max(self._raw.seek(0, io.SEEK_END), *ends, 0) if is_end else offset
        return self._at

    def write(self, data: Any) -> int:
        """Write bytes, at first to the disk and after its first failure to memory."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        if not self.error:
            try:
                self._raw.seek(self._at)
                while rest:
                    rest = rest[self._raw.write(rest) :]
            except OSError as error:
                self.error = error
        if rest:
            self._refused.append((self._at + size - len(rest), bytes(rest)))
        return size

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer with what was written; bytes beyond the end are 0."""
        view = memoryview(buffer).cast("B")
        self._raw.seek(self._at)
        got = self._raw.readinto(view) or 0
        view[got:] = bytes(len(view) - got)
        for start, data in self._refused:
            low, high = max(start, self._at), min(start + len(data), self._at + len(view))
            if low < high:
                view[low - self._at : high - self._at] = data[low - start : high - start]
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file."""
        size = self._at if size is None else size
        if not self.error:
            try:
                self._raw.truncate(size)
            except OSError as error:
                self.error = error
        return size

    def close(self) -> None:
        """Close the file."""
        self._raw.close()
        super().close()
