"""Waiting for the disk in a thread of its own, so that a slow disk does not hold up the writer."""

from __future__ import annotations

import os
import threading
import time


class DiskSync:
    """Calls fsync for an open file whenever it is asked, never two at a time.

    Attributes:
        longest_s: the longest call so far, seconds.
    """

    def __init__(self, descriptor: int) -> None:
        self.longest_s = 0.0
        self._descriptor = descriptor
        self._is_asked = threading.Event()
        self._is_over = False
        self._since: float | None = None
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="disk sync", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Ask for a call; return at once.

        Raises:
            OSError: if one before has failed.
        """
        if self._error is not None:
            raise self._error
        self._is_asked.set()

    def waiting_s(self) -> float:
        """Return for how long the present call takes already; 0 without one."""
        since = self._since
        return 0.0 if since is None else time.monotonic() - since

    def end(self) -> None:
        """Call a last time, and wait for it.

        Raises:
            OSError: if the disk fails.
        """
        self._is_over = True
        self._is_asked.set()
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        while not self._is_over:
            self._is_asked.wait()
            self._is_asked.clear()
            self._since = time.monotonic()
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                self._error = error
                return
            finally:
                self.longest_s = max(self.longest_s, time.monotonic() - self._since)
                self._since = None
