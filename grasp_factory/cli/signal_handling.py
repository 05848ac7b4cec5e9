"""Ctrl-C and SIGTERM as exceptions that leave all in good order, wherever they come."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any, NoReturn

from grasp_factory.errors import Terminated

RETRY_S = 0.01
"""Seconds after which is tried again what could not be raised, or was lost."""


@contextlib.contextmanager
def signals_as_exceptions() -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` at Ctrl-C and ``Terminated`` at SIGTERM, once.

    A second Ctrl-C ends it at once; so the workers end, too, and the store is as after a power cut.
    """
    wanted: type[KeyboardInterrupt] = KeyboardInterrupt

    def stop(number: int, frame: FrameType | None) -> None:
        nonlocal wanted
        if number != signal.SIGALRM:
            wanted = Terminated if number == signal.SIGTERM else KeyboardInterrupt
            _end_at_once_next_time(128 + number)
        if _is_importing(frame):
            try_again()
        else:
            raise wanted

    def try_again() -> None:
        signal.signal(signal.SIGALRM, stop)
        signal.setitimer(signal.ITIMER_REAL, RETRY_S)

    def is_lost(what: Any) -> None:
        """Hear of an exception that a finaliser could not raise."""
        if isinstance(what.exc_value, KeyboardInterrupt):
            try_again()
        elif not _is_stopping():
            unraisable(what)

    numbers = signal.SIGTERM, signal.SIGINT, signal.SIGALRM
    before = {number: signal.getsignal(number) for number in numbers}
    unraisable = sys.unraisablehook
    sys.unraisablehook = is_lost
    signal.signal(signal.SIGTERM, stop)
    # A shell starts what is in the background with Ctrl-C ignored; so it stays.
    if before[signal.SIGINT] in (signal.default_int_handler, _interrupt_late):
        signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGALRM) is stop:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before[signal.SIGALRM])
        if _is_stopping():  # and so until its end
            _pass_over_what_was_cut()
        else:
            sys.unraisablehook = unraisable
            signal.signal(signal.SIGTERM, before[signal.SIGTERM])
            if signal.getsignal(signal.SIGINT) is stop:
                signal.signal(signal.SIGINT, _interrupt_late)


def leave(code: int) -> NoReturn:
    """Exit; after a signal without Python's own end.

    Threads and coroutines that the exception cut through would lament there, at any length.
    """
    if _is_stopping():
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(code)
    sys.exit(code)


def _stop_already(*_: Any) -> None:
    """Take another SIGTERM: it is being stopped."""


def _is_stopping() -> bool:
    return signal.getsignal(signal.SIGTERM) is _stop_already


def _pass_over_what_was_cut() -> None:
    # The exception may have come between the making of a coroutine of Zarr's and its start.
    warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)


def _end_at_once_next_time(code: int) -> None:
    _pass_over_what_was_cut()
    # `timeout` sends SIGTERM twice. Not SIG_IGN: Python complains of a signal on its way meanwhile.
    signal.signal(signal.SIGTERM, _stop_already)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: os._exit(code))


def _is_importing(frame: FrameType | None) -> bool:
    """Say whether a module is half imported; libraries go on with it after an exception."""
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


def _interrupt_late(*_: Any) -> None:
    """Take Ctrl-C when the command is done: Python's own end would be torn with a traceback."""
    if not threading.main_thread().is_alive():
        os._exit(128 + signal.SIGINT)
    raise KeyboardInterrupt
