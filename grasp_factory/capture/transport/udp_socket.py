"""A UDP socket whose datagrams have the time at which the kernel received them."""

from __future__ import annotations

import contextlib
import socket
import struct
import sys
import time
from dataclasses import dataclass

from grasp_factory.errors import CaptureError

MOST_BYTES = 65_535
"""Largest datagram."""
_RECEIVE_BUFFER = 1 << 20
"""Bytes that the kernel keeps while this process is late: a second at 1 kHz and 1 kB."""
_SO_TIMESTAMPNS = 35
"""Of Linux: asm-generic/socket.h."""
_TIMESPEC = struct.Struct("@qq")
_OLDEST_NS = 10**9
"""An older time of arrival is not believed: the clock of the day was set meanwhile."""
_AT_ONCE_NS, _TRIES = 5_000, 5


@dataclass(frozen=True, slots=True)
class Datagram:
    """A datagram."""

    data: bytes
    sender: str
    """Address of the machine that sent it."""
    host_ns: int
    """``time.monotonic_ns()`` when it had arrived."""


class UdpSocket:
    """A socket that listens, or that talks to one peer and hears no other.

    Args:
        listen: address and port to listen at; None for a port that the system chooses.
        peer: address and port of the peer; None to hear everybody.
    """

    def __init__(
        self, *, listen: tuple[str, int] | None = None, peer: tuple[str, int] | None = None
    ) -> None:
        self._listen, self._peer = listen, peer
        self._socket: socket.socket | None = None
        self._last_ns = 0
        """Times of arrival ascend, although they are known to a microsecond only."""

    @property
    def name(self) -> str:
        """Address and port, for messages."""
        host, port = self._peer or self._listen or ("", 0)
        return f"{host}:{port}"

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return int(self._opened().getsockname()[1])

    @property
    def is_open(self) -> bool:
        """Whether it is open."""
        return self._socket is not None

    def open(self) -> None:
        """Open the socket.

        Raises:
            CaptureError: if the address does not exist, or the port is taken.
        """
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
            if sys.platform == "linux":
                made.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            if self._listen:
                made.bind(self._listen)
            if self._peer:
                made.connect(self._peer)
        except (OSError, OverflowError, UnicodeError) as error:
            made.close()
            raise CaptureError(
                f"UDP {self.name} cannot be used: {error}; valid: an address of this network and a"
                " free port"
            ) from None
        self._socket = made

    def receive(self, timeout_s: float) -> Datagram | None:
        """Return the next datagram; None after the timeout, or if the peer is not there now."""
        opened = self._opened()
        opened.settimeout(timeout_s)
        try:
            data, ancillary, _, sender = opened.recvmsg(MOST_BYTES, socket.CMSG_SPACE(16))
        except (TimeoutError, ConnectionError):
            return None
        except OSError as error:
            raise CaptureError(f"UDP {self.name} is lost: {error}") from None
        self._last_ns = max(self._last_ns, _arrival_ns(ancillary))
        return Datagram(data, str(sender[0]) if sender else "", self._last_ns)

    def send(self, data: bytes, to: tuple[str, int] | None = None) -> None:
        """Send a datagram; one that the network refuses is lost, as others may be."""
        with contextlib.suppress(OSError):
            if to is None:
                self._opened().send(data)
            else:
                self._opened().sendto(data, to)

    def close(self) -> None:
        """Close the socket."""
        made, self._socket = self._socket, None
        if made is not None:
            made.close()

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise CaptureError(f"UDP {self.name} is not open")
        return self._socket


def _arrival_ns(ancillary: list[tuple[int, int, bytes]]) -> int:
    """Return the kernel's time of a datagram on the monotonic clock; now if it has none."""
    now, offset = _clocks()
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, part = _TIMESPEC.unpack(data)
            arrived = seconds * 10**9 + part + offset
            return arrived if now - _OLDEST_NS < arrived <= now else now
    return now


def _clocks() -> tuple[int, int]:
    """Return the monotonic clock, and what to add to the time of day to get it, ns.

    The clocks are read one after the other; if something came between, they are read again.
    """
    for _ in range(_TRIES):
        before, day, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if after - before < _AT_ONCE_NS:
            break
    return after, (before + after) // 2 - day
