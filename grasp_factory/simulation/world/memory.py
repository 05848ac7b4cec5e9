"""Files in memory, for data that the engine accepts only by file name."""

from __future__ import annotations

import os


def file_in_memory(name: str, data: bytes) -> str:
    """Return the path of a file that exists until this process ends.

    A killed process leaves no file. No other content can have the same name, which matters
    because the engine caches files by name.

    Raises:
        OSError: if a lack of memory, or a limit on files, prevents writing all of it.
    """
    descriptor = os.memfd_create(name)
    try:
        left = memoryview(data)
        while left:  # a limit shortens the first write; only the next one raises
            left = left[os.write(descriptor, left) :]
    except BaseException:
        os.close(descriptor)
        raise
    return f"/proc/self/fd/{descriptor}"
