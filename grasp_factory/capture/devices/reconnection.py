"""Waiting for a device that went away."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

from grasp_factory.errors import CaptureError

POLL_S = 0.05
"""Longest wait before a driver looks whether it shall stop; the contract allows 0.2 s."""
_RETRY_S = 0.1


def reconnect(
    connect: Callable[[], None], stopped: Event, limit_s: float, lost: CaptureError
) -> bool:
    """Connect again and again until it works; return False if ``stopped`` is set meanwhile.

    Args:
        connect: connects once, or raises CaptureError.
        stopped: ends the waiting.
        limit_s: how long to wait.
        lost: what happened, the error to raise in the end.

    Raises:
        CaptureError: if the device does not come back in time.
    """
    end = time.monotonic() + limit_s
    while not stopped.is_set():
        try:
            connect()
        except CaptureError:
            if time.monotonic() >= end:
                break
            stopped.wait(_RETRY_S)
        else:
            return True
    if stopped.is_set():
        return False
    raise CaptureError(
        f"{lost}; it did not come back within {limit_s:g} s: plug it in again, or raise the setting"
        " reconnect_s"
    )
