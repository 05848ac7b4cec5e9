"""A store's directory for Zarr: no link is followed, and each file is written atomically."""

from __future__ import annotations

from collections.abc import AsyncIterator, Iterable

from zarr.abc.store import (
    ByteRequest,
    OffsetByteRequest,
    RangeByteRequest,
    Store,
    SuffixByteRequest,
)
from zarr.core.buffer import Buffer, BufferPrototype, default_buffer_prototype

from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import Place
from grasp_factory.core.place_tree import files_below


class AtomicStore(Store):
    """Files below a place. ``3.0`` is written as ``3.0.partial`` first.

    A file is read in the thread that asks for it, in less time than another thread takes to start.

    Attributes:
        place: the directory.
    """

    supports_writes = supports_deletes = supports_listing = True

    def __init__(self, place: Place, *, read_only: bool = False) -> None:
        super().__init__(read_only=read_only)
        self._is_open = True
        self.place = place

    def __str__(self) -> str:
        return str(self.place)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, AtomicStore) and self.place.path == other.place.path

    def __hash__(self) -> int:
        return hash(self.place.path)

    def with_read_only(self, read_only: bool = False) -> AtomicStore:
        """See ``zarr.abc.store.Store.with_read_only``."""
        return AtomicStore(self.place, read_only=read_only)

    def read(self, key: str, byte_range: ByteRequest | None = None) -> bytes | None:
        """Return the content of a file, or a part of it; None if there is no file.

        Raises:
            StoreError: if it is no regular file, or larger than the limit.
        """
        file = self.place / key
        try:
            if byte_range is None:
                return file.read_bytes(CHUNK)
            opened = file.parent.open_parts(file.name)
            start, stop = _part(opened.size, byte_range)
        except (FileNotFoundError, NotADirectoryError):
            return None
        try:
            CHUNK.check(stop - start, file)
            return opened.read(stop - start, start)
        finally:
            opened.close()

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """See ``zarr.abc.store.Store.get``."""
        content = self.read(key, byte_range)
        if content is None:
            return None
        return (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    async def get_partial_values(
        self,
        prototype: BufferPrototype,
        key_ranges: Iterable[tuple[str, ByteRequest | None]],
    ) -> list[Buffer | None]:
        """See ``zarr.abc.store.Store.get_partial_values``."""
        return [await self.get(key, prototype, part) for key, part in key_ranges]

    async def exists(self, key: str) -> bool:
        """See ``zarr.abc.store.Store.exists``."""
        return (self.place / key).is_file()

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file; replace what a killed writer left of it."""
        self._check_writable()
        file = self.place / key
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write(value.as_buffer_like())

    async def delete(self, key: str) -> None:
        """See ``zarr.abc.store.Store.delete``."""
        self._check_writable()
        (self.place / key).unlink(missing_ok=True)

    async def list(self) -> AsyncIterator[str]:
        """See ``zarr.abc.store.Store.list``."""
        for file in files_below(self.place):
            yield file.below(self.place)

    async def list_prefix(self, prefix: str) -> AsyncIterator[str]:
        """See ``zarr.abc.store.Store.list_prefix``."""
        async for key in self.list():
            if key.startswith(prefix):
                yield key

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """See ``zarr.abc.store.Store.list_dir``."""
        for found in (self.place / prefix.rstrip("/")).glob("*"):
            yield found.name


def _part(size: int, asked: ByteRequest | None) -> tuple[int, int]:
    """Return where the asked part of a file of ``size`` bytes begins and ends, within the file."""
    match asked:
        case RangeByteRequest(start, end):
            first, last = start, end
        case OffsetByteRequest(offset):
            first, last = offset, size
        case SuffixByteRequest(suffix):
            first, last = size - suffix, size
        case _:
            first, last = 0, size
    first = min(max(first, 0), size)
    return first, min(max(last, first), size)
