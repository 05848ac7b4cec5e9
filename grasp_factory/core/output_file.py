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
    """A format that files have, and how to know it."""

    what: str
    """With its article: a GIF animation."""
    suffix: str
    """Lower case, with the dot."""
    magic: bytes
    """What such files have near their beginning."""
    offset: int = 0
    """Bytes before that."""

    def is_that_of(self, path: Path) -> bool:
        """Say whether an existing file is of this format.

        Raises:
            OSError: if it cannot be read.
        """
        with path.open("rb") as file:
            head = file.read(self.offset + len(self.magic))
        return head[self.offset :] == self.magic


def check_out(path: Path, kinds: Sequence[FileKind]) -> FileKind:
    """Return the format that a file's name asks for, if it may be written there.

    A file that is there already is replaced if it has that format, and is let alone otherwise.

    Raises:
        UsageError: if the name ends otherwise, the folder does not exist or is a store's, or
            something else is there.
    """
    kind = next((kind for kind in kinds if path.suffix.lower() == kind.suffix), None)
    if kind is None:
        valid = " or ".join(kind.suffix for kind in kinds)
        raise UsageError(f"{path}: what would it be? valid: a name that ends in {valid}")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if is_in_store(path):
        raise UsageError(f"{path} is inside a store, which holds data only: choose another folder")
    try:
        is_free = not path.exists() or (path.is_file() and kind.is_that_of(path))
    except OSError as error:
        raise UsageError(f"{path} cannot be replaced: {error.strerror}") from None
    if not is_free:
        raise UsageError(f"{path} is there and is not {kind.what}: choose another name")
    return kind


def is_in_store(path: Path) -> bool:
    """Say whether a path is that of a Zarr store or inside one, links on the way followed."""
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
