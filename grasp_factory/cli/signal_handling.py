"""Ctrl-C and SIGTERM as exceptions, whenever they come."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any, NoReturn

from grasp_factory.core.process_end import ignore_unstarted_coroutines
from grasp_factory.errors import Terminated

RETRY_S = 0.01
"""Seconds until an exception that could not be raised, or was lost, is raised again."""


@contextlib.contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` at Ctrl-C and ``Terminated`` at SIGTERM, once.

    A second Ctrl-C ends the process at once, and the workers with it. The store is then as after a
    power cut: committed episodes stay.
    """
    wanted: type[KeyboardInterrupt] = KeyboardInterrupt

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal wanted
        if number != signal.SIGALRM:
            wanted = Terminated if number == signal.SIGTERM else KeyboardInterrupt
            _exit_at_the_next_signal(128 + number)
        if _is_importing(frame):
            try_again()
        else:
            raise wanted

    def try_again() -> None:
        signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)

    def is_lost(what: Any) -> None:
        """Handle an exception that was raised in a finalizer, where Python drops it."""
        if isinstance(what.exc_value, KeyboardInterrupt):
            try_again()
        elif not _is_stopping():
            unraisable(what)

    numbers = signal.SIGTERM, signal.SIGINT, signal.SIGALRM
    before = {number: signal.getsignal(number) for number in numbers}
    unraisable = sys.unraisablehook
    sys.unraisablehook = is_lost
    signal.signal(signal.SIGTERM, stop)
    # A shell starts background processes with Ctrl-C ignored: leave it ignored.
    if before[signal.SIGINT] in (signal.default_int_handler, _interrupt_after_the_command):
        signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGALRM) is stop:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before[signal.SIGALRM])
        if _is_stopping():  # until the process ends
            ignore_unstarted_coroutines()
        else:
            sys.unraisablehook = unraisable
            signal.signal(signal.SIGTERM, before[signal.SIGTERM])
            if signal.getsignal(signal.SIGINT) is stop:
                signal.signal(signal.SIGINT, _interrupt_after_the_command)


def leave(code: int) -> NoReturn:
    """Exit; after a signal, skip Python's own shutdown.

    Threads and coroutines that the exception interrupted would print tracebacks there.
    """
    if _is_stopping():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(code)
    sys.exit(code)


def _ignore_sigterm(*_: Any) -> None:
    """Ignore another SIGTERM: the process is stopping already."""


def _is_stopping() -> bool:
    return signal.getsignal(signal.SIGTERM) is _ignore_sigterm


def _exit_at_the_next_signal(code: int) -> None:
    ignore_unstarted_coroutines()
    # `timeout` sends SIGTERM twice. With SIG_IGN, Python would complain about a pending signal.
    signal.signal(signal.SIGTERM, _ignore_sigterm)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: os._exit(code))


def _is_importing(frame: FrameType | None) -> bool:
    """Return whether an import is in progress; libraries would use the half-imported module."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _interrupt_after_the_command(*_: Any) -> None:
    """Handle Ctrl-C after the command: Python's own shutdown would print a traceback."""
    if not threading.main_thread().is_alive():
        os._exit(128 + signal.SIGINT)
    raise KeyboardInterrupt
