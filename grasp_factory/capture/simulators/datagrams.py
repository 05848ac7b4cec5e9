"""The common part of simulated devices that send datagrams on the loopback."""

from __future__ import annotations

import socket
from abc import abstractmethod
from threading import Lock
from typing import Any

from grasp_factory.capture.samples import Payload_co
from grasp_factory.capture.simulators.base import SimulatedSender
from grasp_factory.capture.simulators.faults import NO_FAULTS, Faults, Spoiler
from grasp_factory.core.episode import Episode

LOOPBACK = "127.0.0.1"


class SimulatedUdpDevice(SimulatedSender[Payload_co]):
    """Sends a datagram for each sample; see ``SimulatedDevice`` for the arguments.

    Of the faults, it knows lost samples, batches, the counter's start and the clock. UDP has a
    checksum of its own.
    """

    def __init__(self, episode: Episode, *, faults: Faults = NO_FAULTS, **playing: Any) -> None:
        super().__init__(episode, faults=faults, **playing)
        self._spoiler = Spoiler(faults)
        self._held: list[bytes] = []
        self._lock = Lock()
        self._socket: socket.socket | None = None

    @abstractmethod
    def datagram(self, payload: Any, number: int, device_ns: int) -> bytes:
        """Return the datagram of a payload."""

    @abstractmethod
    def receiver(self) -> tuple[str, int] | None:
        """Return where to send; None while nobody listens."""

    def bound(self) -> tuple[str, int] | None:
        """Return the address of its own; None for one that the system chooses."""
        return None

    def is_lost(self) -> bool:
        """See ``SimulatedSender.is_lost``."""
        return self._spoiler.is_lost()

    def send(self, place: int, number: int, device_ns: int) -> bool:
        """See ``SimulatedSender.send``."""
        data = self.datagram(self.track.payloads[place], number, device_ns)
        if self.faults.batch_s:
            self._held.append(data)
            return True
        return self.post(data)

    def flush(self) -> None:
        """See ``SimulatedSender.flush``."""
        held, self._held = self._held, []
        for data in held:
            self.post(data)

    def post(self, data: bytes) -> bool:
        """Send a datagram; return whether it went out."""
        with self._lock:
            to = self.receiver()
            if self._socket is None or to is None:
                return False
            try:
                self._socket.sendto(data, to)
            except ConnectionError:
                return False
            return True

    def plug(self) -> None:
        """See ``SimulatedDevice.plug``."""
        with self._lock:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._socket.setblocking(False)
                if address := self.bound():
                    self._socket.bind(address)

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        with self._lock:
            made, self._socket = self._socket, None
            if made is not None:
                made.close()

    def heard(self) -> tuple[bytes, tuple[str, int]] | None:
        """Return a datagram that came, and its sender; None if there is none now."""
        with self._lock:
            if self._socket is None:
                return None
            try:
                return self._socket.recvfrom(_MOST_BYTES)
            except (BlockingIOError, ConnectionError):
                return None


_MOST_BYTES = 2048


def free_port() -> int:
    """Return a UDP port of the loopback that nobody uses now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])
