"""A store's directory for Zarr: each file is written atomically, under a predictable name."""

from __future__ import annotations

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
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
        file = self.root / key
        if file.exists() and not file.is_file():
            raise OSError(f"{key} is no file")
        return await super().get(key, prototype, byte_range)

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file; replace what a killed writer left of it."""
        self._check_writable()
        file = self.root / key
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, value.as_buffer_like())
