"""Files in memory, for what the engine takes by name only."""

from __future__ import annotations

import os


def file_in_memory(name: str, data: bytes) -> str:
    """Return the path of a file that lives as long as this process.

    A killed process leaves nothing behind, and no other content can come under its name, for the
    engine caches files by name.

    Raises:
        OSError: if memory, or a limit on files, does not let all of it be written.
    """
    descriptor = os.memfd_create(name)
    try:
        left = memoryview(data)
        while left:  # a limit cuts the first write short, and only the next one tells
            left = left[os.write(descriptor, left) :]
    except BaseException:
        os.close(descriptor)
        raise
    return f"/proc/self/fd/{descriptor}"
