"""OS errors caused by the disk, permissions or limits."""

from __future__ import annotations

import errno

from grasp_factory.errors import DISK_TROUBLE

MACHINE_TROUBLE = DISK_TROUBLE | {
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
"""Numbers of these errors."""
GO_ON = "what is committed stays: mend that and run the same command again to go on"
"""Ends the message of a run that such an error stopped."""
NO_THREAD = "can't start new thread"
"""Text of the RuntimeError that Python raises where processes or memory are limited."""
