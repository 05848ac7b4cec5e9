"""Start a child process with its own environment, and without interrupts meanwhile."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

OF_A_WORKER = {
    name: "1"
    for name in (
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "MKL_NUM_THREADS",
        "BLOSC_NTHREADS",
        "OPENCV_FOR_THREADS_NUM",
        "PYTHONSAFEPATH",
    )
}
"""Environment variables of workers: one thread, because the workers share the cores already; and
modules are not looked for in the current folder before they have the path of their parent."""

_ENVIRONMENT = threading.RLock()
_POSTPONED = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)


@contextlib.contextmanager
def environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables for a while; a child started meanwhile inherits them.

    One thread at a time: a second would take the first one's values for those of before.
    """
    with _ENVIRONMENT:
        before = {name: os.environ.get(name) for name in values}
        try:
            os.environ.update(values)
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value


@contextlib.contextmanager
def no_interrupt() -> Iterator[None]:
    """Postpone signals to the end of the block; a child started meanwhile never receives Ctrl-C.

    The child inherits the signal mask. For this process a mask is not enough: another thread, such
    as one of OpenBLAS, may receive the signal, and then Python runs its handler in the main thread
    nevertheless. A child whose start is cut short ends with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        with _handled_later():
            yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _handled_later() -> Iterator[None]:
    """Run Python's signal handlers at the end of the block; they run in the main thread alone."""
    came: list[int] = []
    is_main = threading.current_thread() is threading.main_thread()
    handlers = {number: signal.getsignal(number) for number in _POSTPONED if is_main}
    ours = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in ours:
            signal.signal(number, lambda number, frame: came.append(number))
        yield
    finally:
        for number, handler in ours.items():
            signal.signal(number, handler)
        for missed in came:
            signal.raise_signal(missed)


@contextlib.contextmanager
def without_lost_script() -> Iterator[None]:
    """Start a child although this process's script is no file, such as a script from a pipe.

    A child runs the script again to have its functions, and would fail without the file.
    """
    main = sys.modules["__main__"]
    name = getattr(main, "__file__", None)
    if name is None or Path(name).is_file():
        yield
        return
    del main.__file__
    try:
        yield
    finally:
        main.__file__ = name


def check_main_guard() -> None:
    """End a worker that begins to run its parent's script once more, with one line on stderr."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(
            "A worker process imports the script that started it, and the script starts workers"
            ' again: put the call under `if __name__ == "__main__":`'
        )
