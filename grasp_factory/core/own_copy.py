"""Files that have a second name (a hard link) are written aside before anything is appended.

Tools that keep versions of files, such as DVC with ``cache.type=hardlink``, let a file and its copy
in their cache be one file with two names. Appending to it would change the cache too.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from grasp_factory.core.limits import Limit
from grasp_factory.core.locked_file import has_name
from grasp_factory.core.place import Place
from grasp_factory.core.regular_file import read_part


def make_own(file: Place, limit: Limit) -> None:
    """Replace a file that has several names by a copy that has one; do nothing to other files.

    The file is locked (flock) meanwhile, so that appenders that lock it lose nothing.

    Raises:
        BlockingIOError: if another process holds the lock.
        IrregularFileError: if it is a link or no regular file.
        LimitError: if it is larger than the limit.
        OSError: if the disk fails.
    """
    try:
        descriptor, size = file.parent.open_file(file.name)
    except FileNotFoundError:
        return
    try:
        if os.fstat(descriptor).st_nlink == 1:
            return
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with file.above() as (folder, name):
            is_still_there = has_name(descriptor, Path(name), folder)
        if is_still_there:
            limit.check(size, file)
            file.write(read_part(descriptor, os.fstat(descriptor).st_size), durable=True)
    finally:
        os.close(descriptor)
