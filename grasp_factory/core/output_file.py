"""Files that a command writes for its user: where they may go, and writing them atomically."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.atomic_file import replacing
from grasp_factory.errors import StoreError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class FileKind:
    """A file format, and how to recognise it."""

    what: str
    """Its name with the article: a GIF animation."""
    suffix: str
    """Lower case, with the dot."""
    magic: bytes
    """Bytes near the beginning of each such file."""
    offset: int = 0
    """Bytes before the magic."""

    def is_that_of(self, path: Path) -> bool:
        """Return whether an existing file is of this format.

        Raises:
            OSError: if it cannot be read.
        """
        with path.open("rb") as file:
            head = file.read(self.offset + len(self.magic))
        return head[self.offset :] == self.magic


def check_out(path: Path, kinds: Sequence[FileKind]) -> FileKind:
    """Return the format that a file's name stands for, if the file may be written.

    An existing file is replaced if it has that format; another one is an error.

    Raises:
        UsageError: if the name has another suffix, the folder does not exist or is in a store, or
            another file has the name.
    """
    kind = next((kind for kind in kinds if path.suffix.lower() == kind.suffix), None)
    if kind is None:
        valid = " or ".join(kind.suffix for kind in kinds)
        raise UsageError(f"{path}: unknown format, valid: a name that ends in {valid}")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if is_in_store(path):
        raise UsageError(f"{path} is inside a store, which holds data only: choose another folder")
    try:
        is_free = not path.exists() or (path.is_file() and kind.is_that_of(path))
    except OSError as error:
        raise UsageError(f"{path} cannot be replaced: {error.strerror}") from None
    if not is_free:
        raise UsageError(f"{path} exists and is not {kind.what}: choose another name")
    return kind


def is_in_store(path: Path) -> bool:
    """Return whether a path is a Zarr store or inside one; links on the way are followed."""
    real = Path(os.path.realpath(path.parent), path.name)
    return any((above / "zarr.json").exists() for above in (real, *real.parents))


@contextlib.contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Yield a name beside ``path`` to write to; the file becomes ``path`` when the block succeeds.

    It has the same suffix. After an error nothing of it stays.

    Raises:
        StoreError: if it cannot be written.
    """
    try:
        with replacing(path, path.with_name(f".{path.stem}.partial{path.suffix}")) as partial:
            yield partial
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror or error}") from None
