"""Ends the reads of chunks that go on after one of them has failed.

Zarr reads the chunks of a selection as tasks of an event loop in a thread of its own. When one task
fails, the others go on: they take processor time, and Python prints each one that is still pending
when the process ends.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from zarr.core.sync import sync


class _Reads:
    """Counts the reads of all threads, because the tasks in the loop do not say whose they are."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._has_failed = False

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Count a read; the last one cancels what the failed ones left pending."""
        with self._lock:
            self._count += 1
        try:
            yield
        except BaseException:
            self._has_failed = True
            raise
        finally:
            with self._lock:
                self._count -= 1
                if self._has_failed and not self._count:
                    sync(_cancel_pending())
                    self._has_failed = False


async def _cancel_pending() -> None:
    """Cancel all other tasks of this loop; their errors are those of a read that has failed."""
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)
    pending = asyncio.all_tasks() - {asyncio.current_task()}
    for task in pending:
        task.cancel()
    await asyncio.gather(*pending, return_exceptions=True)


ending_failed_reads = _Reads().ending
"""A context in which values of arrays are read."""
