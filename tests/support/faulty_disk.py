"""A disk that fails: calls of the operating system that raise, for the files below one folder."""

from __future__ import annotations

import builtins
import contextlib
import io
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

CALLS = ("fsync", "replace", "mkdir", "open", "unlink", "rmdir", "pwrite", "ftruncate")
"""Functions of ``os`` that change a disk, or wait for it; ``open`` is the other one."""


class _Short(io.FileIO):
    """A file that takes the first half of what is written, and no more."""

    def __init__(self, file: Any, mode: str, error: int) -> None:
        super().__init__(file, mode)
        self._error = error

    def write(self, data: Any) -> int:
        super().write(memoryview(data).cast("B")[: memoryview(data).nbytes // 2])
        raise OSError(self._error, os.strerror(self._error))


def _path_of(descriptor: int) -> str:
    return os.readlink(f"/proc/self/fd/{descriptor}")


class FaultyDisk:
    """Follows what is done below a folder, and lets some of it fail.

    Attributes:
        done: what was done, in words such as ``fsync ds.zarr/zarr.json``, failures included.
        has_failed: whether anything has.
    """

    def __init__(
        self, folder: Path, is_first: Callable[[str], bool], error: int, *, stays: bool
    ) -> None:
        """Fail at the first of these calls, and at all after it if that ``stays``."""
        self.done: list[str] = []
        self.has_failed = False
        self._folder = os.path.realpath(folder)
        self._is_first, self._error, self._stays = is_first, error, stays
        self._lock = threading.Lock()

    @contextlib.contextmanager
    def installed(self) -> Iterator[FaultyDisk]:
        """Put it in the place of the operating system for a while."""
        with contextlib.ExitStack() as stack:
            for name in CALLS:
                stack.enter_context(mock.patch.object(os, name, self._wrapped(name)))
            for module in (io, builtins):
                stack.enter_context(mock.patch.object(module, "open", self._opened(io.open)))
            yield self

    def _wrapped(self, name: str) -> Callable[..., Any]:
        real = getattr(os, name)

        def call(first: Any, *args: Any, **more: Any) -> Any:
            is_reading = name == "open" and not (args and args[0] & (os.O_WRONLY | os.O_RDWR))
            above = next((more[key] for key in ("dir_fd", "src_dir_fd") if more.get(key)), None)
            file = first if above is None else os.path.join(_path_of(above), first)
            if not is_reading and self._fails(name, file):
                raise OSError(self._error, os.strerror(self._error), str(first))
            return real(first, *args, **more)

        return call

    def _opened(self, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(file: Any, mode: str = "r", *args: Any, **more: Any) -> Any:
            if not set(mode) & set("wax+") or not self._fails("write", file):
                return real(file, mode, *args, **more)
            short = _Short(file, mode.replace("b", "").replace("t", ""), self._error)
            return short if "b" in mode else io.TextIOWrapper(short, write_through=True)

        return call

    def _fails(self, what: str, file: Any) -> bool:
        try:
            name = _path_of(file) if isinstance(file, int) else file
            name = os.path.abspath(os.fspath(name))
        except OSError:
            return False
        if not name.startswith(self._folder):
            return False
        with self._lock:  # several threads sync
            self.done.append(f"{what} {os.path.relpath(name, self._folder)}")
            if self.has_failed:
                return self._stays
            self.has_failed = self._is_first(self.done[-1])
            return self.has_failed
