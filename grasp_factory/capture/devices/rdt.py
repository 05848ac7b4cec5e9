"""Force-torque sensors that speak ATI's Raw Data Transfer over UDP, each with its own scales.

A request has 8 bytes, big-endian: 0x1234, a command, a number. A record has 36 bytes, big-endian:
the number of the record, the number of the sensor's own sample, a status, six int32.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.serial_device import LONGEST_WAIT_S
from grasp_factory.capture.devices.udp_device import UdpDevice
from grasp_factory.capture.samples import Sample, WrenchReading
from grasp_factory.capture.transport.counting import UnwrappedClock
from grasp_factory.capture.transport.udp_socket import Datagram, UdpSocket
from grasp_factory.core.geometry import Array
from grasp_factory.core.serialization import check, check_range, normalise

REQUEST, RECORD = struct.Struct(">HHI"), struct.Struct(">III6i")
MAGIC = 0x1234
STOP, START = 0x0000, 0x0002
PORT = 49_152


@dataclass(frozen=True, slots=True, kw_only=True)
class RdtSettings:
    """The settings of sensors over RDT."""

    host: str
    """Address or name of the sensor."""
    port: int = PORT
    reconnect_s: float = 10.0
    """How long a sensor that went away is waited for."""

    def __post_init__(self) -> None:
        normalise(self)
        is_name = 0 < len(self.host) <= 253 and self.host.isprintable() and " " not in self.host
        check(is_name, "host", self.host, "an address such as 192.168.1.1")
        check_range(self, "port", 1, 65_535)
        check_range(self, "reconnect_s", 0.0, LONGEST_WAIT_S, "s")


class RdtSensor(UdpDevice[WrenchReading]):
    """A driver of a sensor over RDT.

    Args:
        settings: where it is.
        commands: commands and their numbers, sent before the stream begins.
        scales: (6,) N and N m of one count.
        sample_hz: rate of the sensor's own samples, whose number is then its clock; 0 for none.
    """

    def __init__(
        self,
        settings: RdtSettings,
        commands: tuple[tuple[int, int], ...],
        scales: Array,
        sample_hz: float,
    ) -> None:
        socket = UdpSocket(peer=(settings.host, settings.port))
        super().__init__(socket, connect_s=1.0, reconnect_s=settings.reconnect_s)
        self._commands, self._scales, self._sample_hz = commands, scales, sample_hz
        self._clock = UnwrappedClock(bits=32)

    def start_stream(self) -> None:
        """See ``UdpDevice.start_stream``."""
        self._clock = UnwrappedClock(bits=32)
        for command, number in (*self._commands, (START, 0)):
            self._socket.send(REQUEST.pack(MAGIC, command, number))

    def end_stream(self) -> None:
        """See ``UdpDevice.end_stream``."""
        self._socket.send(REQUEST.pack(MAGIC, STOP, 0))

    def decode(self, datagram: Datagram) -> Sample[WrenchReading] | None:
        """See ``UdpDevice.decode``."""
        if len(datagram.data) != RECORD.size:
            self.counters.implausible += 1
            return None
        raw, sample, status, *counts = RECORD.unpack(datagram.data)
        sequence = self.number(raw)
        if sequence is None:
            return None
        if status:
            self.counters.flagged += 1
        device_ns = None
        if self._sample_hz:
            device_ns = round(self._clock.unwrap(sample) * 1e9 / self._sample_hz)
        return Sample(
            device_ns=device_ns,
            host_ns=datagram.host_ns,
            sequence=sequence,
            payload=WrenchReading(wrench=np.array(counts) * self._scales),
        )
