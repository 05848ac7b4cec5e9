"""The file of the annotation log: reading while it grows, appending under a lock, its folder."""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from grasp_factory.core.limits import LOG
from grasp_factory.core.locked_file import open_locked
from grasp_factory.core.own_copy import make_own
from grasp_factory.core.place import Place, fsync_places, place_of
from grasp_factory.core.regular_file import check_regular
from grasp_factory.dataset.annotations.lines import decode
from grasp_factory.errors import StoreBusyError, StoreError
from grasp_factory.writers.zarr.metadata_checksum import is_sealed
from grasp_factory.writers.zarr.placeholder import write_placeholder

FOLDER, NAME = "annotations", "log.jsonl"
DESCRIPTION = "place of log.jsonl, what people say of episodes; not derived, only appended to"
WAIT_S = 30.0
"""Seconds to wait for the lock; a change holds it for milliseconds."""
_WINDOW = 1 << 16


def log_file(store: Path) -> Place:
    """Return the place of a store's log, whether it exists or not.

    Raises:
        OSError: if there is no store.
    """
    return place_of(store) / FOLDER / NAME


@contextlib.contextmanager
def reading(store: Path) -> Iterator[int | None]:
    """Yield the descriptor of a store's log, open for reading; None if it has no log.

    Raises:
        StoreError: if it cannot be read, is no regular file, or the path contains a link.
        LimitError: if it is larger than the limit.
    """
    file = store / FOLDER / NAME
    try:
        descriptor = log_file(store).open()
    except (FileNotFoundError, NotADirectoryError):
        yield None
        return
    except OSError as error:
        raise _cannot("read", file, error) from None
    try:
        LOG.check(os.fstat(descriptor).st_size, file)
        yield descriptor
    except OSError as error:
        raise _cannot("read", file, error) from None
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def appending(store: Path) -> Iterator[int]:
    """Yield the descriptor of the log, created if missing, and locked until the block ends.

    An unfinished last line of a killed writer is removed.

    Raises:
        StoreError: if it cannot be written.
        StoreBusyError: if another process holds the lock for too long.
    """
    file = store / FOLDER / NAME
    try:
        log = log_file(store)
        is_first = not log.parent.exists()
        log.parent.mkdir(exist_ok=True)
        descriptor = _take(log)
    except OSError as error:
        raise _cannot("written", file, error) from None
    try:
        if not is_sealed(log.parent / "zarr.json"):
            write_placeholder(place_of(store), FOLDER, DESCRIPTION)
        if not os.fstat(descriptor).st_size:
            fsync_places([log.parent])  # the file may be new
        settle(descriptor)
        yield descriptor
    except OSError as error:
        if is_first and not os.fstat(descriptor).st_size:
            with contextlib.suppress(OSError):
                log.parent.rmtree()
        raise _cannot("written", file, error) from None
    finally:
        os.close(descriptor)  # this releases the lock


def append(store: Path, descriptor: int, data: bytes) -> None:
    """Append all of the data to the log of a store, or nothing, and wait until it is on the disk.

    Raises:
        OSError: if the disk fails or is full.
        LimitError: if readers would refuse the log.
    """
    size = os.fstat(descriptor).st_size
    LOG.check(size + len(data), store / FOLDER / NAME)
    try:
        left = memoryview(data)
        while left:
            left = left[os.write(descriptor, left) :]
        os.fsync(descriptor)
    except BaseException:
        with contextlib.suppress(OSError):
            os.ftruncate(descriptor, size)
        raise


def settle(descriptor: int) -> bool:
    """Remove an unfinished last line; return whether there was one.

    A complete line that lacks only its line break gets one: an editor may have left it out.
    """
    size = os.fstat(descriptor).st_size
    last = _last_line(descriptor, size)
    if not last:
        return False
    try:
        decode(last)
    except ValueError:
        os.ftruncate(descriptor, size - len(last))
    else:
        os.write(descriptor, b"\n")
    return True


def replace_log(store: Path, data: bytes) -> None:
    """Write the log of a store that is not published yet.

    Raises:
        OSError: if the disk fails.
        LimitError: if readers would refuse the log.
    """
    LOG.check(len(data), store / FOLDER / NAME)
    write_placeholder(place_of(store), FOLDER, DESCRIPTION)
    log_file(store).write(data, durable=True)


def _last_line(descriptor: int, size: int) -> bytes:
    """Return the bytes after the last line break."""
    window = _WINDOW
    while True:
        data = os.pread(descriptor, window, max(size - window, 0))
        if b"\n" in data or window >= size:
            return data[data.rfind(b"\n") + 1 :]
        window *= 2


def _take(log: Place) -> int:
    """Return the log's descriptor, locked; wait while another process holds the lock."""
    deadline = time.monotonic() + WAIT_S
    check = partial(check_regular, file=log.path, is_written=True)
    while True:
        try:
            make_own(log, LOG)
            with log.above() as (folder, name):
                return open_locked(
                    Path(name), flags=os.O_APPEND, mode=0o666, check=check, folder=folder
                )
        except BlockingIOError:
            if time.monotonic() > deadline:
                what = f"another process holds it for more than {WAIT_S:.0f} s"
                raise StoreBusyError(f"{log} cannot be written: {what}; try again") from None
            time.sleep(0.005)


def _cannot(what: str, file: Path, error: OSError) -> StoreError:
    why = error.strerror or str(error)
    if error.errno in (errno.EACCES, errno.EPERM, errno.EROFS) and what == "written":
        why += "; the store can be read, but not annotated, by you at this place"
    return StoreError(f"{file} cannot be {what}: {why}")
