"""Output folders of commands: nothing is overwritten, and they appear when they are complete."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from grasp_factory.core.output_file import is_in_store
from grasp_factory.errors import UsageError


def check_free(out: Path, what: str) -> None:
    """Check that a folder can be created.

    Args:
        out: its path.
        what: what creates it, in a message, such as "an export".

    Raises:
        UsageError: if its name is taken, its parent does not exist, or it is inside a store.
    """
    if not out.parent.is_dir():
        raise UsageError(f"{out}: the folder {out.parent} does not exist")
    if is_in_store(out):
        raise UsageError(f"{out} is inside a store, which holds data only: choose another folder")
    if os.path.lexists(out):
        raise _occupied(out, what)


def publish(built: Path, out: Path, what: str) -> None:
    """Move a complete folder to its place, unless something exists there by now.

    It is one call, so that a process that is killed leaves the whole folder or nothing. Of what
    appears at the last instant, the call replaces nothing but an empty folder.

    Raises:
        UsageError: if something exists there.
        OSError: if the disk fails; then there is nothing.
    """
    if os.path.lexists(out):
        raise _occupied(out, what)
    try:
        os.replace(built, out)
    except (FileExistsError, NotADirectoryError):
        raise _occupied(out, what) from None
    except OSError as error:
        if error.errno == errno.ENOTEMPTY:
            raise _occupied(out, what) from None
        raise


def _occupied(out: Path, what: str) -> UsageError:
    return UsageError(f"{out} exists, and {what} overwrites nothing: choose another name")
