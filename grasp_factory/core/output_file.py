"""Output files of commands: checks of their paths, and atomic writing."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from secrets import token_hex

from grasp_factory.core.atomic_file import replacing
from grasp_factory.errors import StoreError, UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class FileKind:
    """A file format and how to recognize it."""

    what: str
    """Name of the format with an article, such as: a GIF animation."""
    suffix: str
    """Suffix of file names, in lower case, with the dot."""
    magic: bytes
    """Bytes that such files have at ``offset``."""
    offset: int = 0
    """Number of bytes before ``magic``."""

    def is_that_of(self, path: Path) -> bool:
        """Return whether an existing file has this format.

        Raises:
            OSError: if it cannot be read.
        """
        with path.open("rb") as file:
            head = file.read(self.offset + len(self.magic))
        return head[self.offset :] == self.magic


def check_out(path: Path, kinds: Sequence[FileKind]) -> FileKind:
    """Return the format that belongs to the suffix of a path, if a file may be written there.

    An existing file may be replaced only if it has this format.

    Raises:
        UsageError: if the suffix is unknown, the folder does not exist or is inside a store, or
            the path exists and is not a file of this format.
    """
    kind = next((kind for kind in kinds if path.suffix.lower() == kind.suffix), None)
    if kind is None:
        valid = " or ".join(kind.suffix for kind in kinds)
        raise UsageError(f"{path}: unknown file format, valid: a name that ends in {valid}")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if is_in_store(path):
        raise UsageError(f"{path} is inside a store: choose another folder")
    try:
        is_free = not path.exists() or (path.is_file() and kind.is_that_of(path))
    except OSError as error:
        raise UsageError(f"{path} cannot be replaced: {error.strerror}") from None
    if not is_free:
        raise UsageError(f"{path} exists and is not {kind.what}: choose another name")
    return kind


def is_in_store(path: Path) -> bool:
    """Return whether a path is a Zarr store or inside one; links are followed."""
    real = Path(os.path.realpath(path.parent), path.name)
    return any((above / "zarr.json").exists() for above in (real, *real.parents))


@contextlib.contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder; rename it to ``path`` after the block.

    It has the same suffix, and a name that nobody can guess: in a folder from a stranger a link of
    that name could lead to any file. If the block raises, the temporary file is removed.

    Raises:
        StoreError: if the file cannot be written.
    """
    try:
        partial = path.with_name(f".{token_hex(8)}.partial{path.suffix}")
        partial.touch(exist_ok=False)
        with replacing(path, partial):
            yield partial
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror or error}") from None
