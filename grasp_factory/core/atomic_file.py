"""Writing a file so that its readers find all of it or none, and waiting until it is on the disk.

The bytes are written under another name in the same folder, and then renamed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

PARTIAL = ".partial"
"""Ends the names of files that are being written."""
_PARALLEL_SYNCS = 16
"""Files that are waited for at once; on a local disk a block's 140 take a fifth of the time."""


def partial_path(file: Path) -> Path:
    """Return the name under which ``write_atomic`` writes a file before it is renamed."""
    return file.with_name(file.name + PARTIAL)


def write_atomic(
    file: Path, data: bytes | bytearray | memoryview, *, durable: bool = False
) -> None:
    """Write a file, or replace it.

    After an error the partial file stays; the next write replaces it.

    Args:
        file: the file.
        data: its new content.
        durable: return when the file and its name are on the disk.

    Raises:
        OSError: if it cannot be written.
    """
    with partial_path(file).open("wb") as partial:
        partial.write(data)
    move_into_place(partial_path(file), file, durable=durable)


@contextlib.contextmanager
def replacing(file: Path, partial: Path) -> Iterator[Path]:
    """Yield ``partial`` to write to; it becomes ``file`` when the block succeeds.

    After an error the partial file is removed.

    Raises:
        OSError: if it cannot be renamed.
    """
    try:
        yield partial
        move_into_place(partial, file)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        raise


def move_into_place(partial: Path, file: Path, *, durable: bool = False) -> None:
    """Rename a file that is written completely; one that has the name already is replaced.

    Raises:
        OSError: if it cannot be renamed.
    """
    if durable:  # first the content: a power cut must not leave the name with nothing in it
        _fsync(partial)
    partial.replace(file)
    if durable:
        _fsync(file.parent)


def fsync(paths: Iterable[Path]) -> None:
    """Wait until these files or directories are on the disk.

    A directory's fsync makes the names in it durable: files created, renamed or removed there.
    All are waited for at once, so that the file system can write them together.

    Raises:
        OSError: if the disk fails.
    """
    waited_for = list(paths)
    with ThreadPoolExecutor(_PARALLEL_SYNCS) as pool:
        try:
            done = pool.map(_fsync, waited_for)
        except RuntimeError:  # the process may start no more threads
            done = map(_fsync, waited_for)
        for _ in done:
            pass  # an exception of one of them is raised here


def fsync_tree(root: Path) -> None:
    """Wait until everything below ``root``, and ``root`` itself, is on the disk."""
    fsync([*root.rglob("*"), root])


def _fsync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
