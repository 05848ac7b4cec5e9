"""OS errors that are caused by the disk, permissions or limits, not by episodes or this program."""

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
"""End of the error message when such an error has stopped a run."""
NO_THREAD = "can't start new thread"
"""Message of Python's RuntimeError when a limit on processes or memory is reached."""


@contextlib.contextmanager
def adding_how_to_continue(path: Path | None = None) -> Iterator[None]:
    """Convert disk errors to StoreErrors that say how to continue.

    ``path`` is named in the message if the error itself names no file.

    Raises:
        StoreError: for an OSError in ``MACHINE_ERRNOS``, or a StoreError caused by an OSError.
    """
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
