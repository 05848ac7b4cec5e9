"""Files that must be regular files of their own: no link, no pipe, no device."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from grasp_factory.core.limits import Limit
from grasp_factory.errors import IrregularFileError

_FLAGS = os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC  # opening a pipe would block


def open_regular(file: Path, flags: int) -> int:
    """Return the descriptor of a file; links in the path of its folder are followed.

    Args:
        file: the file.
        flags: of ``os.open``, in addition. A file that is opened for writing must not be a second
            name of another file (a hard link), which could lie anywhere.

    Raises:
        IrregularFileError: if it is a link, or no regular file.
        OSError: if it cannot be opened.
    """
    try:
        descriptor = os.open(file, flags | _FLAGS, 0o666)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO, errno.EISDIR):
            raise irregular(file) from None
        raise
    try:
        check_regular(descriptor, file, is_written=bool(flags & (os.O_WRONLY | os.O_RDWR)))
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def check_regular(descriptor: int, file: Path, *, is_written: bool) -> None:
    """Check an open file; see ``open_regular``."""
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode) or (is_written and found.st_nlink > 1):
        raise irregular(file)


def read_part(descriptor: int, size: int, start: int = 0) -> bytes:
    """Return bytes of an open file, fewer at its end. One call of Linux reads at most 2 GiB."""
    data = os.pread(descriptor, size, start)
    while len(data) < size:
        more = os.pread(descriptor, size - len(data), start + len(data))
        if not more:
            break
        data += more
    return data


def read_and_close(descriptor: int, size: int, limit: Limit, where: object) -> bytes:
    """Return the content of an open file of ``size`` bytes, and close it.

    Raises:
        LimitError: naming ``where``, if it has more bytes than the limit.
    """
    try:
        limit.check(size, where)
        return read_part(descriptor, size)
    finally:
        os.close(descriptor)


def irregular(file: Path) -> IrregularFileError:
    """Return the error to raise for a link, a second name, or an irregular file."""
    if os.path.islink(file):
        what = "is a link, and a store's files must be its own"
        return IrregularFileError(f"{file} {what}: put a copy of what it leads to in its place")
    if os.path.isfile(file):
        what = "has a second name (a hard link), and would be changed there too"
        return IrregularFileError(f"{file} {what}: put a copy of it in its place")
    return IrregularFileError(f"{file} is in the way: it is no regular file; move it")


def check_inside(root: Path, inner: str) -> None:
    """Check that a path below a root does not lead out of it.

    Raises:
        IrregularFileError: if a part of it is ``..``.
    """
    if ".." in inner and ".." in inner.split("/"):
        raise IrregularFileError(f"{root / inner} leads out of {root}: no part may be '..'")


def check_parts(root: Path, inner: str) -> None:
    """Check that no part of a path below a root is a link or an irregular file.

    Raises:
        IrregularFileError: naming the first one.
    """
    path = root
    for part in inner.split("/"):
        path = path / part
        try:
            mode = path.lstat().st_mode
        except OSError:
            return
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise irregular(path) from None
