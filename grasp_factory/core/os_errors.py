"""OS errors that the disk, permissions or limits cause, not the episode and not the program."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from grasp_factory.errors import StoreError

MACHINE_ERRNOS = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EROFS,
    errno.EFBIG,
    errno.EACCES,
    errno.EPERM,
    errno.ENOMEM,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENODEV,
    errno.EAGAIN,
    errno.ENOLCK,
    errno.ENOTCONN,
    errno.ECONNRESET,
    errno.EHOSTDOWN,
    errno.ESTALE,
    errno.ETIMEDOUT,
}
"""Error numbers that come from the disk, permissions and limits."""
HOW_TO_CONTINUE = "committed episodes stay: solve this and run the same command again to continue"
"""End of the message of a run that such an error stopped."""
NO_THREAD = "can't start new thread"
"""Message of Python's RuntimeError where the number of processes or the memory is limited."""


@contextlib.contextmanager
def adding_how_to_continue(path: Path | None = None) -> Iterator[None]:
    """Add to an error of the disk what it means for the store, and its path where none is named."""
    try:
        yield
    except OSError as error:
        if error.errno not in MACHINE_ERRNOS:
            raise
        where = error.filename or path
        named = f"{where}: " if where else ""
        raise StoreError(f"{named}{error.strerror}; {HOW_TO_CONTINUE}") from None
    except StoreError as error:
        is_of_disk = isinstance(error.__context__, OSError)
        if not is_of_disk or str(error).endswith(HOW_TO_CONTINUE):
            raise
        raise StoreError(f"{error}; {HOW_TO_CONTINUE}") from None
