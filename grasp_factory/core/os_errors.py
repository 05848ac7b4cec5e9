"""OS errors that the disk, permissions or limits cause, not the episode and not the program."""

from __future__ import annotations

import errno

MACHINE_TROUBLE = {
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
GO_ON = "committed episodes stay: solve this and run the same command again to continue"
"""End of the message of a run that such an error stopped."""
NO_THREAD = "can't start new thread"
"""Message of Python's RuntimeError where the number of processes or the memory is limited."""
