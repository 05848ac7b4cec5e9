"""A temporary folder for the files of one process; it also removes those of dead processes."""

from __future__ import annotations

import contextlib
import glob
import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

_MAKER = re.compile(r"(\d+)-\w+")
"""Process id and the suffix from ``tempfile``; the rest of a longer host name does not match."""

_SIGN = re.compile(r"[^\w.-]")


@contextlib.contextmanager
def scratch_folder(parent: Path, name: str) -> Iterator[Path]:
    """Yield a new folder ``.NAME-HOST-PID-*``; remove it at the end.

    Characters of the name that mean something in a URI or a pattern become ``_``. First remove such
    folders in ``parent`` whose process on this host does not exist any more.

    Args:
        parent: where to create the folder; files can be moved from it to ``parent``.
        name: the start of the folder's name.

    Raises:
        OSError: if the folder cannot be created.
    """
    head = f".{_SIGN.sub('_', name)}-{socket.gethostname()}-"
    for left in parent.glob(f"{glob.escape(head)}*"):
        maker = _MAKER.fullmatch(left.name.removeprefix(head))
        if maker and not Path("/proc", maker[1]).exists():
            shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(
        dir=parent, prefix=f"{head}{os.getpid()}-", ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)
