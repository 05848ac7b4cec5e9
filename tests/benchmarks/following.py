"""A process that reads a session's file behind the recorder, and frees what it has read.

So a long session needs little disk, and yet every byte of it is written to the disk and read again.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import resource
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Self

from grasp_factory.capture.session.mcap_scan import McapScan

_KEEP_SIZE, _PUNCH_HOLE = 1, 2
"""Of fallocate(2)."""
_PAUSE_S = 0.2
_LONGEST_S = 120.0
"""That the end of the file may take after the session has ended."""


class Follower:
    """Follows a file inside of a ``with`` block.

    Attributes:
        messages: those in the file, by device and topic, after ``finish``.
        trouble: why not all of it could be read; empty if all was.
        cores_s: processor time that the process took, s.
    """

    def __init__(self, file: Path, keep: int) -> None:
        """Start; the file need not be there yet.

        Args:
            file: the MCAP file.
            keep: bytes behind the reader that stay on the disk.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_follow, args=(file, keep, theirs), daemon=True)
        self._process.start()
        self.messages: dict[tuple[str, str], int] = {}
        self.trouble, self.cores_s = "", 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.join()

    def finish(self) -> None:
        """Wait until all is read: call it when the session has ended."""
        self._pipe.send("ended")
        if not self._pipe.poll(_LONGEST_S):
            raise SystemExit(f"the reader did not come to the end within {_LONGEST_S:g} s")
        self.messages, self.trouble, self.cores_s = self._pipe.recv()


def _follow(file: Path, keep: int, pipe: Connection) -> None:
    while not file.exists() or file.stat().st_size < 8:
        time.sleep(_PAUSE_S)
    descriptor = os.open(file, os.O_RDWR)
    scan = McapScan(descriptor, with_checksums=True)
    counts: Counter[int] = Counter()
    freed, is_over = 0, False
    while not (is_over or scan.is_complete):
        is_over = pipe.poll(_PAUSE_S)
        scan.size = os.fstat(descriptor).st_size
        counts.update(head.channel_id for head in scan.messages())
        freed += _free(descriptor, freed, scan.end - keep)
    found = {
        (scan.channels[k].metadata.get("device", ""), scan.channels[k].topic): count
        for k, count in counts.items()
    }
    used = resource.getrusage(resource.RUSAGE_SELF)
    pipe.send((found, "" if scan.is_complete else scan.trouble, used.ru_utime + used.ru_stime))


def _free(descriptor: int, start: int, stop: int) -> int:
    """Give whole pages of a part of a file back to the disk; return how many bytes."""
    page = os.sysconf("SC_PAGE_SIZE")
    size = (stop - start) // page * page
    if size <= 0:
        return 0
    libc = ctypes.CDLL(None, use_errno=True)
    call = libc.fallocate64
    call.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    if call(descriptor, _KEEP_SIZE | _PUNCH_HOLE, start, size):
        raise OSError(ctypes.get_errno(), "the file system cannot free a part of a file")
    return size
