"""An open file of a store, of which parts are read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

from grasp_factory.core.regular_file import read_part


class FileParts:
    """A file on this machine, by its descriptor, which this object closes.

    Attributes:
        size: its bytes.
    """

    def __init__(self, descriptor: int, size: int) -> None:
        self._descriptor, self.size = descriptor, size

    def read(self, length: int, start: int) -> bytes:
        """Return bytes from ``start`` on, fewer at the file's end."""
        return read_part(self._descriptor, length, start)

    def several(self, parts: Sequence[tuple[int, int]]) -> Iterator[tuple[int, bytes | memoryview]]:
        """Yield index and content of parts, each given by start and length, in any order."""
        return ((k, self.read(length, start)) for k, (start, length) in enumerate(parts))

    def tail(self, length: int) -> bytes:
        """Return the last bytes; all of a file that is shorter."""
        start = max(self.size - length, 0)
        return self.read(self.size - start, start)

    def close(self) -> None:
        """Close the file."""
        os.close(self._descriptor)
