"""What the file of a session may ask a reader for: a small file can hold much once it is expanded.

Time and memory follow the bytes that the file takes on the disk. A file with holes, and a chunk of
many small or equal records that was compressed, takes few of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable

from grasp_factory.core.disk_usage import bytes_on_disk
from grasp_factory.core.limits import EXPANDED, RECORDS

LARGEST_RATIO = 200
"""Bytes after expansion for each byte on the disk; images of a covered lens reach a hundred."""
LEAST_RECORD = 8
"""Bytes on the disk that a record takes, compressed; the index of a message alone has 16."""


class ReadingBudget:
    """Counts what is read of a file in one pass. The file may grow meanwhile."""

    def __init__(self, descriptor: int, where: object) -> None:
        """Begin to count, for an open file and its name in messages.

        Raises:
            LimitError: if the file is large, and nearly all of it is not on the disk.
        """
        self._descriptor, self._where = descriptor, where
        self._disk = self._bytes = self._records = 0
        self._free_records = RECORDS.usual
        self.expand(os.fstat(descriptor).st_size)

    def expand(self, size: int) -> None:
        """Count bytes that a part of the file was expanded to.

        Raises:
            LimitError: if they are too many.
        """
        self._bytes += size
        EXPANDED.check(self._bytes - LARGEST_RATIO * self._on_disk(), self._where)

    def count(self, records: int = 1) -> None:
        """Count records.

        Raises:
            LimitError: if they are too many.
        """
        self._records += records
        if self._records > self._free_records:
            allowed = self._on_disk() // LEAST_RECORD
            RECORDS.check(self._records - allowed, self._where)
            self._free_records = RECORDS.usual + allowed

    def _on_disk(self) -> int:
        self._disk = max(self._disk, bytes_on_disk(os.fstat(self._descriptor)))
        return self._disk


class CountedReads:
    """An open file for a library whose every record takes two reads or more."""

    def __init__(self, read: Callable[[int], bytes], budget: ReadingBudget, most: int) -> None:
        """Take the file's own method, what counts, and the bytes of the whole file."""
        self._read, self._budget, self._most, self._reads = read, budget, most, 0

    def read(self, size: int) -> bytes:
        """Return the next bytes, fewer at the end of the file: room is made for no more.

        Raises:
            LimitError: if there are too many reads.
        """
        self._reads += 1
        if self._reads % 2 == 0:
            self._budget.count()
        return self._read(min(size, self._most))
