"""Threads of a server beside a run: signals are for the main thread, which must end the run."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator


@contextlib.contextmanager
def signals_elsewhere() -> Iterator[None]:
    """Block signals in threads that start in the block: the main thread must receive Ctrl-C."""
    ours = {signal.SIGINT, signal.SIGTERM, signal.SIGALRM}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ours)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
