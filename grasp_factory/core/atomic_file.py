"""Atomic writing of files, and waiting until files are on the disk (fsync).

The bytes are written to a temporary file in the same folder, which is then renamed. A reader never
sees a part of the new content.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import chain, islice
from pathlib import Path
from threading import Lock
from typing import TypeVar

T = TypeVar("T")

PARTIAL = ".partial"
"""Suffix of files that are being written."""
_PARALLEL_SYNCS = 16
"""Number of parallel fsync calls; on a local disk a block's 140 files take a fifth of the time."""


def partial_path(file: Path) -> Path:
    """Return the name under which ``write_atomic`` writes a file before it is renamed."""
    return file.with_name(file.name + PARTIAL)


def write_atomic(
    file: Path, data: bytes | bytearray | memoryview, *, durable: bool = False
) -> None:
    """Write or replace a file.

    After an error the partial file stays; the next write replaces it. A link in its place is not
    followed: it is removed, as such a file is.

    Args:
        file: the file.
        data: its new content.
        durable: wait until the file and its name are on the disk.

    Raises:
        OSError: if it cannot be written.
    """
    partial_path(file).unlink(missing_ok=True)
    with partial_path(file).open("xb") as partial:
        partial.write(data)
    move_into_place(partial_path(file), file, durable=durable)


@contextlib.contextmanager
def replacing(file: Path, partial: Path) -> Iterator[Path]:
    """Yield ``partial`` to write to; rename it to ``file`` if the block succeeds.

    If the block fails, the partial file is removed.

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
    """Rename a completely written file to its final name; an existing file is replaced.

    With ``durable``, also wait until the file and its name are on the disk.

    Raises:
        OSError: if it cannot be renamed.
    """
    if durable:  # the content first: a power cut must not leave an empty file of this name
        _fsync(partial)
    partial.replace(file)
    if durable:
        _fsync(file.parent)


def fsync(paths: Iterable[Path]) -> None:
    """Wait until these files or directories are on the disk.

    The fsync of a directory makes changes of its entries durable: files created, renamed or
    removed. The calls run in parallel, so that the file system can write the files together.

    Raises:
        OSError: if the disk fails.
    """
    _at_once(_fsync, paths)


def fsync_descriptors(opened: Iterable[Callable[[], int]]) -> None:
    """Wait as ``fsync`` does for what these functions open; the descriptors are closed.

    Raises:
        OSError: if the disk fails.
    """
    _at_once(_fsync_descriptor, opened)


def _at_once(wait: Callable[[T], None], items: Iterable[T]) -> None:
    waiting = iter(items)
    first = list(islice(waiting, _PARALLEL_SYNCS))
    left: Iterator[T] = chain(first, waiting)
    lock = Lock()

    def until_none_is_left() -> None:
        while True:
            with lock:
                item = next(left, None)
            if item is None:
                return
            wait(item)

    running: list[Future[None]] = []
    with ThreadPoolExecutor(_PARALLEL_SYNCS) as pool:
        try:
            with contextlib.suppress(RuntimeError):  # the process may start no more threads
                running.extend(pool.submit(until_none_is_left) for _ in first)
            if not running:
                until_none_is_left()
            for done in running:
                done.result()
        except BaseException:  # an fsync failed, or Ctrl-C: the other threads end too
            left = iter(())
            raise


def _fsync(path: Path) -> None:
    _fsync_descriptor(lambda: os.open(path, os.O_RDONLY))


def _fsync_descriptor(opened: Callable[[], int]) -> None:
    descriptor = opened()
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
