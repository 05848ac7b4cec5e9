"""The common part of drivers that read packets from a serial line."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from threading import Event
from typing import Generic

from grasp_factory.capture.devices.base import DeviceCounters
from grasp_factory.capture.devices.reconnection import POLL_S, reconnect
from grasp_factory.capture.samples import Payload_co, Sample
from grasp_factory.capture.transport.arrival import ArrivalTimes
from grasp_factory.capture.transport.framing import Framer, Packet, PacketFormat
from grasp_factory.capture.transport.serial_port import BITS_PER_BYTE, LineLostError, SerialPort
from grasp_factory.core.serialization import check, check_range, normalise

LONGEST_WAIT_S = 3600.0
"""Largest value of ``reconnect_s``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SerialSettings:
    """The settings of every serial device."""

    port: str
    """Path of the port, such as /dev/ttyUSB0."""
    baudrate: int = 115_200
    reconnect_s: float = 10.0
    """How long a device that went away is waited for."""
    is_paced: bool = True
    """Whether bytes come at the baud rate. Then packets that one read brings together are spread
    over the time that their bytes took. A USB device without a UART ignores the baud rate."""

    def __post_init__(self) -> None:
        normalise(self)
        is_path = 0 < len(self.port) <= 1000 and "\0" not in self.port
        check(is_path, "port", self.port, "the path of a serial port")
        check_range(self, "baudrate", 300, 12_000_000)
        check_range(self, "reconnect_s", 0.0, LONGEST_WAIT_S, "s")

    @property
    def byte_ns(self) -> int:
        """Time of a byte on the line, ns; 0 if it is not known."""
        return BITS_PER_BYTE * 10**9 // self.baudrate if self.is_paced else 0


class SerialDevice(ABC, Generic[Payload_co]):
    """Reads, frames and decodes packets; connects again after the line was lost."""

    def __init__(self, settings: SerialSettings, packets: PacketFormat) -> None:
        self.counters = DeviceCounters()
        self._settings, self._format = settings, packets
        self._port = SerialPort(settings.port, settings.baudrate)
        self._stopped = Event()
        self._begin_stream()

    @abstractmethod
    def decode(self, data: bytes, host_ns: int) -> Sample[Payload_co] | None:
        """Return the sample of an accepted packet; None if it comes too late."""

    def start_stream(self) -> bytes:
        """Ask the device for samples, and return the bytes of them that have come with its answer.

        A device that sends by itself needs nothing.

        Raises:
            CaptureError: if the device does not answer.
        """
        return b""

    def restart_stream(self) -> None:
        """Forget what was known of the last stream, before a new one begins."""

    def open(self) -> None:
        """See ``Device.open``."""
        self._stopped.clear()
        self.counters = DeviceCounters()
        self._connect()

    def samples(self) -> Iterator[Sample[Payload_co]]:
        """See ``Device.samples``."""
        yield from self._received(self._first)
        while not self._stopped.is_set():
            try:
                data = self._port.read(POLL_S)
            except LineLostError as lost:
                yield from self._decoded(self._framer.finish())
                self._port.close()
                limit = self._settings.reconnect_s
                if reconnect(self._connect, self._stopped, limit, lost):
                    self.counters.reconnects += 1
                data = self._first
            yield from self._received(data)
        yield from self._decoded(self._framer.finish())

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        self._port.close()

    def _connect(self) -> None:
        self._port.open()
        try:
            self._begin_stream()
            self.restart_stream()
            self._first = self.start_stream()
        except BaseException:
            self._port.close()
            raise

    def _begin_stream(self) -> None:
        self._framer = Framer(self._format)
        self._arrivals = ArrivalTimes(self._settings.byte_ns)
        self._counted = (0, 0, 0)
        self._first = b""

    def _received(self, data: bytes) -> Iterator[Sample[Payload_co]]:
        if data:
            self._arrivals.note(len(data), time.monotonic_ns())
            yield from self._decoded(self._framer.feed(data))

    def _decoded(self, packets: list[Packet]) -> Iterator[Sample[Payload_co]]:
        self._count()
        for packet in packets:
            sample = self.decode(packet.data, self._arrivals.at(packet.end))
            if sample is not None:
                self.counters.samples += 1
                yield sample

    def _count(self) -> None:
        """Add what the framer counted since the last time; each connection has its own framer."""
        framer, counters = self._framer, self.counters
        found = (framer.bad_checksums, framer.implausible, framer.skipped_bytes)
        before = self._counted
        counters.bad_checksums += found[0] - before[0]
        counters.implausible += found[1] - before[1]
        counters.skipped_bytes += found[2] - before[2]
        self._counted = found
