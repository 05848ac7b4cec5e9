"""A store's directory for Zarr: each file is written atomically, under a predictable name."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from zarr.abc.store import (
    ByteRequest,
    OffsetByteRequest,
    RangeByteRequest,
    SuffixByteRequest,
)
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype
from zarr.storage import LocalStore

from grasp_factory.core.atomic_file import write_atomic


class AtomicStore(LocalStore):
    """Writes ``3.0`` as ``3.0.partial`` first.

    LocalStore's own partial names are random: to find what a killed writer left of one block, every
    array's directory would have to be listed, with a name for each block in it.
    """

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Read a file.

        Raises:
            OSError: unless it is a regular file: opening a FIFO blocks.
        """
        # In this thread: a file is read in less time than another thread takes to start.
        content = self.read(key, byte_range)
        if content is None:
            return None
        return (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    def read(self, key: str, byte_range: ByteRequest | None = None) -> bytes | None:
        """Return the content of a file, or a part of it; None if there is no file.

        Raises:
            OSError: unless it is a regular file.
        """
        return _read(self.root / key, byte_range)

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file; replace what a killed writer left of it."""
        self._check_writable()
        file = self.root / key
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, value.as_buffer_like())


def _read(path: Path, part: ByteRequest | None) -> bytes | None:
    """Return the content of a regular file, or a part of it; None if there is no file."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        return None
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{path.name} is no file")
        match part:
            case RangeByteRequest(start, end):
                first, size = start, end - start
            case OffsetByteRequest(offset):
                first, size = offset, status.st_size
            case SuffixByteRequest(suffix):
                first, size = max(status.st_size - suffix, 0), suffix
            case _:
                first, size = 0, status.st_size
        with open(file, "rb", closefd=False) as content:
            content.seek(first)
            return content.read(max(min(size, status.st_size), 0))  # a damaged index asks for more
    finally:
        os.close(file)
