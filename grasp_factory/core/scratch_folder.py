"""A folder for the files of one process while it works."""

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
"""Process id, and what ``tempfile`` appends; the dashes of a longer host name do not match."""


@contextlib.contextmanager
def scratch_folder(parent: Path, name: str) -> Iterator[Path]:
    """Yield a new folder ``.NAME-HOST-PID-*``, which is removed at the end.

    Those that killed processes of this host have left in ``parent`` are removed first.

    Args:
        parent: the folder to make it in, for files that are to be moved there.
        name: what its name begins with.

    Raises:
        OSError: if it cannot be made.
    """
    head = f".{name}-{socket.gethostname()}-"
    for left in parent.glob(f"{glob.escape(head)}*"):
        maker = _MAKER.fullmatch(left.name.removeprefix(head))
        if maker and not Path("/proc", maker[1]).exists():
            shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(
        dir=parent, prefix=f"{head}{os.getpid()}-", ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)
