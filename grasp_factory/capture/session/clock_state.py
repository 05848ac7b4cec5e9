"""Whether the system keeps its clock by PTP or NTP, as the kernel says.

The daemons of both, such as ptp4l with phc2sys, or chrony, tell the kernel: ntp_adjtime(3).
"""

from __future__ import annotations

import ctypes
import struct
from dataclasses import dataclass

_TIMEX = struct.Struct("@Illlli")
"""The first fields of ``struct timex``: modes, offset, freq, maxerror, esterror, status."""
_TIMEX_BYTES = 512
"""More than the structure has; a call that sets nothing reads 0 as its modes."""
_TIME_ERROR, _UNSYNCHRONISED, _NANOSECONDS = 5, 0x40, 0x2000


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockState:
    """The system's clock."""

    is_synchronised: bool
    """Whether PTP or NTP keeps it."""
    offset_s: float
    """Last measured offset to the reference, seconds."""
    estimated_error_s: float
    largest_error_s: float


def clock_state() -> ClockState | None:
    """Return the state; None where the system does not say it."""
    try:
        ask = ctypes.CDLL(None).ntp_adjtime
    except (OSError, AttributeError):
        return None
    data = ctypes.create_string_buffer(_TIMEX_BYTES)
    state = ask(data)
    if state < 0:
        return None
    _, offset, _, largest, estimated, status = _TIMEX.unpack_from(data.raw)
    return ClockState(
        is_synchronised=state != _TIME_ERROR and not status & _UNSYNCHRONISED,
        offset_s=offset / (1e9 if status & _NANOSECONDS else 1e6),
        estimated_error_s=estimated / 1e6,
        largest_error_s=largest / 1e6,
    )
