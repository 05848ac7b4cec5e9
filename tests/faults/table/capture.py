"""Faults in the room ``capture``: what is recorded from real sensors."""

from __future__ import annotations

from faults.fault import Fault

FAULTS = (
    Fault(
        "modbus-checksum-starts-at-zero",
        "capture/transport/checksums.py",
        "    crc = 0xFFFF\n",
        "    crc = 0x0000\n",
        ("capture/test_framing.py",),
    ),
    Fault(
        "lost-samples-counted-modulo-16-bits",
        "capture/session/session_reading.py",
        "SEQUENCES = 2**32\n",
        "SEQUENCES = 2**16\n",
        ("capture/test_session_recording.py",),
    ),
)
