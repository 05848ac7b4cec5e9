"""The address of a store in object storage, as a path: ``s3://bucket/folder/grasps.zarr``."""

from __future__ import annotations

import os
import re
from pathlib import Path, PosixPath
from typing import TYPE_CHECKING, NoReturn

from grasp_factory.errors import UsageError, shown

if TYPE_CHECKING:
    from grasp_factory.core.place import Place

SCHEMES = {"s3": "S3", "gs": "Google Cloud Storage", "az": "Azure Blob Storage"}
"""What may stand before ``://``."""
MOST_CHARACTERS = 1024
"""Longest key of an object in S3, bytes of UTF-8."""
_ADDRESS = re.compile(rf"({'|'.join(SCHEMES)})://([A-Za-z0-9][A-Za-z0-9._-]{{1,254}})/(.+)")
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


class RemotePath(PosixPath):
    """The address of a store, or of something in it.

    It is a path, so that it goes wherever the path of a store goes. Whatever would open it on the
    local disk gets an error that says what to do.
    """

    def __str__(self) -> str:
        scheme, *parts = self.parts
        return f"{scheme}//{'/'.join(parts)}"

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self)!r})"

    def __fspath__(self) -> str:
        self.refuse()

    @property
    def scheme(self) -> str:
        """The part before ``://``."""
        return self.parts[0].rstrip(":")

    def resolve(self, strict: bool = False) -> RemotePath:
        """Return the address: there are no links."""
        return self

    def stat(self, **_: bool) -> os.stat_result:
        """Return the facts of an object, or of what is below; see ``ObjectPlace.stat``."""
        return self.place().stat()

    def exists(self, **_: bool) -> bool:
        """Return whether there is an object, or one below."""
        return self.place().exists()

    def is_file(self, **_: bool) -> bool:
        """Return whether there is an object."""
        return self.place().is_file()

    def is_dir(self, **_: bool) -> bool:
        """Return whether there are objects below."""
        return self.place().is_dir()

    def place(self) -> Place:
        """Return the place of the store at this address; see ``place_of``."""
        from grasp_factory.core.object_storage.object_place import object_place  # noqa: PLC0415

        return object_place(self)

    def refuse(self) -> NoReturn:
        """Raise the error for what is done on local disks only.

        Raises:
            UsageError: naming the address.
        """
        raise UsageError(
            f"{self}: this command changes a store in place, or needs files on a disk; copy the"
            " store to a disk (aws s3 sync, or what your storage offers), and name the copy"
        )


def store_path(text: str | os.PathLike[str]) -> Path:
    """Return the path of a store from what a user wrote: an address, or a path on this machine.

    Raises:
        UsageError: for an address that cannot be used.
    """
    if isinstance(text, Path):
        return text
    plain = os.fspath(text)
    scheme = _SCHEME.match(plain)
    return Path(plain) if scheme is None else _remote(plain, scheme[1])


def on_disk(text: str | os.PathLike[str]) -> Path:
    """Return the path of a store on this machine.

    Raises:
        UsageError: for an address; see ``RemotePath.refuse``.
    """
    path = store_path(text)
    if isinstance(path, RemotePath):
        path.refuse()
    return path


def is_remote(path: Path | str) -> bool:
    """Return whether a path leads to object storage."""
    return isinstance(path, RemotePath)


def real_path(path: Path) -> Path:
    """Return the absolute path with links followed; an address as it is."""
    return path if is_remote(path) else Path(os.path.realpath(path))


def absolute_path(path: Path) -> Path:
    """Return the absolute path without following links; an address as it is."""
    return path if is_remote(path) else Path(os.path.abspath(path))


def _remote(text: str, scheme: str) -> RemotePath:
    shape = f"valid: {', '.join(f'{name}://BUCKET/STORE' for name in SCHEMES)}"
    if scheme not in SCHEMES:
        raise UsageError(f"{shown(scheme)}:// is no object storage that is known, {shape}")
    if "@" in text.split("/")[2]:  # perhaps a password: the text is not shown
        raise UsageError(
            f"an address may hold no user and no key: set them by environment; {shape}"
        )
    address = _ADDRESS.fullmatch(text.rstrip("/"))
    parts = address[3].split("/") if address else []
    if (
        not address
        or not all(part not in ("", ".", "..") for part in parts)
        or not text.isprintable()
        or any(mark in text for mark in "?#\\")
        or len(text.encode()) > MOST_CHARACTERS
    ):
        raise UsageError(f"address {shown(text)}: {shape}, without ., .., ? and #")
    return RemotePath(f"{scheme}:", address[2], *parts)
