"""Trouble of the machine: what no episode and no program is to blame for."""

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
"""Numbers of errors that come and go with disk, permissions and limits."""
GO_ON = "what is committed stays: mend that and run the same command again to go on"
"""Ends the message of a run that the machine stopped."""
NO_THREAD = "can't start new thread"
"""What Python says, in a RuntimeError, where processes or memory are limited."""
