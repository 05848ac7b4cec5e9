"""A serial line, by pyserial; a pseudo-terminal is one too."""

from __future__ import annotations

import select
import time
from typing import TYPE_CHECKING

from grasp_factory.errors import CaptureError

if TYPE_CHECKING:
    from serial import Serial

MOST_BYTES = 4096
"""Largest piece that one read returns."""
BITS_PER_BYTE = 10
"""Of 8N1: a start bit, eight bits, a stop bit."""


class LineLostError(CaptureError):
    """A line does not work any more: the device was unplugged, or its port is not there."""


class SerialPort:
    """A port with 8 data bits, no parity and 1 stop bit. One process alone has it."""

    def __init__(self, path: str, baudrate: int) -> None:
        self.path, self._baudrate = path, baudrate
        self._port: Serial | None = None

    def open(self) -> None:
        """Open the port; what arrived before is thrown away.

        Raises:
            LineLostError: if it is not there, is busy, or is no serial port.
        """
        import serial  # noqa: PLC0415

        try:
            port = serial.Serial(
                self.path, self._baudrate, timeout=0, write_timeout=0.5, exclusive=True
            )
            port.reset_input_buffer()
        except (OSError, ValueError, serial.SerialException) as error:
            raise LineLostError(
                f"the serial port {self.path} cannot be opened: {error}; valid: the path of a"
                " serial port that no other program uses, such as /dev/ttyUSB0"
            ) from None
        self._port = port

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, at most ``MOST_BYTES``; nothing after the timeout.

        Raises:
            LineLostError: if the line is lost, or the port is not open.
        """
        port = self._opened()
        try:
            if not select.select([port.fileno()], [], [], timeout_s)[0]:
                return b""
            return bytes(port.read(MOST_BYTES))
        except (OSError, TypeError, ValueError) as error:  # SerialException is an OSError
            raise self._lost(error) from None

    def read_after(self, expected: bytes, timeout_s: float) -> bytes | None:
        """Return what follows some bytes, as far as it has come; what was before is thrown away.

        None if they do not arrive within the time.

        Raises:
            LineLostError: if the line is lost.
        """
        seen, end = b"", time.monotonic() + timeout_s
        while (left := end - time.monotonic()) > 0.0:
            seen = (seen + self.read(left))[-2 * MOST_BYTES :]
            _, found, after = seen.partition(expected)
            if found:
                return after
        return None

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            LineLostError: if the line is lost, or takes no bytes for half a second.
        """
        port = self._opened()
        try:
            port.write(data)
        except OSError as error:
            raise self._lost(error) from None

    def close(self) -> None:
        """Let the port go."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def _opened(self) -> Serial:
        if self._port is None:
            raise LineLostError(f"the serial port {self.path} is not open")
        return self._port

    def _lost(self, error: Exception) -> LineLostError:
        return LineLostError(f"the serial port {self.path} is lost: {error}")
