"""Small pictures and clips, cached on disk between runs, by a key of what they show."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

from grasp_factory.core.cache import cache_dir, digest, read, touch, write
from grasp_factory.errors import UsageError

MOST_BYTES = 500_000_000


class Thumbnails:
    """A folder of files, each named by a hash of the key that it belongs to; never in a store.

    If the cache cannot be used, everything is made on request.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Use a folder; None for the one in the cache."""
        self._folder = folder or _folder()

    def get(self, key: str, make: Callable[[], bytes], suffix: str = ".jpg") -> bytes:
        """Return the content of a key; make it if it is not in the folder."""
        if self._folder is None:
            return make()
        name = digest(key.encode())
        file = self._folder / name[:2] / f"{name}{suffix}"
        data = read(file)
        if data:
            touch(file)
            return data
        data = make()
        with contextlib.suppress(UsageError):
            write(file, data)
        return data

    def prune(self, most: int = MOST_BYTES) -> int:
        """Remove the least recently used files until at most ``most`` bytes are left.

        Returns:
            The number of files that were removed.
        """
        files = sorted(self._files(), reverse=True)
        removed = total = 0
        for _, size, path in files:
            total += size
            if total > most:
                with contextlib.suppress(OSError):
                    os.unlink(path)
                    removed += 1
        return removed

    def _files(self) -> list[tuple[float, int, str]]:
        """Return modification time, bytes and path of each file."""
        found = []
        for folder, _, names in os.walk(self._folder) if self._folder else ():
            for name in names:
                path = os.path.join(folder, name)
                with contextlib.suppress(OSError):
                    state = os.stat(path)
                    found.append((state.st_mtime, state.st_size, path))
        return found


def _folder() -> Path | None:
    try:
        return cache_dir() / "thumbnails"
    except UsageError:
        return None
