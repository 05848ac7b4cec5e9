"""A store's directory as Zarr writes to it: each file aside first, under a name known before."""

from __future__ import annotations

from pathlib import Path

from zarr.abc.store import ByteRequest
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import LocalStore

PARTIAL = ".partial"
"""Ends the names of files that are being written."""


def aside(file: Path) -> Path:
    """Return the name under which a file is written before it is renamed."""
    return file.with_name(file.name + PARTIAL)


class AsideStore(LocalStore):
    """Writes ``3.0`` as ``3.0.partial`` first.

    LocalStore's own names aside are random: to find what a killed writer left of one block, every
    array's directory would have to be listed, with a name for each block in it.
    """

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Read a file; what is none fails, for a pipe would be waited for without an end."""
        file = self.root / key
        if file.exists() and not file.is_file():
            raise OSError(f"{key} is no file")
        return await super().get(key, prototype, byte_range)

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file aside and rename it; a file left aside by a killed writer is replaced."""
        self._check_writable()
        file = self.root / key
        file.parent.mkdir(parents=True, exist_ok=True)
        with aside(file).open("wb") as partial:
            partial.write(value.as_buffer_like())
        aside(file).replace(file)
