"""The end of a process: with its parent, and without warnings after a signal."""

from __future__ import annotations

import ctypes
import signal
import sys
import warnings

_PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Ask the kernel to kill this process when its parent ends, even while it runs C code.

    This works only on Linux; elsewhere it does nothing.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)


def ignore_unstarted_coroutines() -> None:
    """Hide a warning after a signal, which may come before a coroutine of Zarr begins."""
    warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
