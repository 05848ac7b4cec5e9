"""The common part of drivers that receive datagrams."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from threading import Event
from typing import Generic

from grasp_factory.capture.devices.base import DeviceCounters
from grasp_factory.capture.devices.reconnection import POLL_S
from grasp_factory.capture.samples import Payload_co, Sample
from grasp_factory.capture.transport.counting import SampleCount
from grasp_factory.capture.transport.udp_socket import Datagram, UdpSocket
from grasp_factory.errors import CaptureError

SILENCE_S = 0.5
"""After such a time without a sample, the device counts as gone, and is asked again."""


class UdpDevice(ABC, Generic[Payload_co]):
    """Receives and decodes datagrams; asks again for samples when none come.

    Args:
        socket: the socket, not yet open.
        connect_s: how long ``open`` waits for the first sample; None to wait for none.
        reconnect_s: how long a silent device is waited for.
    """

    def __init__(self, socket: UdpSocket, *, connect_s: float | None, reconnect_s: float) -> None:
        self.counters = DeviceCounters()
        self._socket, self._stopped = socket, Event()
        self._connect_s, self._reconnect_s = connect_s, reconnect_s
        self._number = SampleCount(bits=32)
        self._first: Sample[Payload_co] | None = None

    @abstractmethod
    def decode(self, datagram: Datagram) -> Sample[Payload_co] | None:
        """Return the sample of a datagram; None, and counted, if it has none."""

    def start_stream(self) -> None:
        """Ask the device for samples; a device that sends by itself needs nothing."""

    def end_stream(self) -> None:
        """Ask the device to send no more samples."""

    def open(self) -> None:
        """See ``Device.open``."""
        self._stopped.clear()
        self.counters = DeviceCounters()
        self._number = SampleCount(bits=32)
        self._first = None
        self._socket.open()
        try:
            self.start_stream()
            if self._connect_s is not None:
                self._first = self._awaited(self._connect_s)
        except BaseException:
            self._socket.close()
            raise

    def samples(self) -> Iterator[Sample[Payload_co]]:
        """See ``Device.samples``."""
        first, self._first = self._first, None
        if first is not None:
            yield self._counted(first)
        heard = asked = time.monotonic()
        while not self._stopped.is_set():
            sample = self._next(POLL_S)
            now = time.monotonic()
            if sample is not None:
                if now - heard > SILENCE_S:
                    self.counters.reconnects += 1
                heard = asked = now
                yield self._counted(sample)
            elif now - heard > SILENCE_S + self._reconnect_s:
                raise self._gone(self._reconnect_s)
            elif now - asked > SILENCE_S:
                asked = now
                self._number.restart()
                self.start_stream()

    def stop(self) -> None:
        """See ``Device.stop``."""
        self._stopped.set()

    def close(self) -> None:
        """See ``Device.close``."""
        if self._socket.is_open:
            self.end_stream()
        self._socket.close()

    def number(self, raw: int) -> int | None:
        """Return the unwrapped number of a sample; None if it comes too late."""
        found = self._number.number(raw)
        self.counters.lost = self._number.lost
        return found

    def _next(self, timeout_s: float) -> Sample[Payload_co] | None:
        datagram = self._socket.receive(timeout_s)
        return None if datagram is None else self.decode(datagram)

    def _awaited(self, limit_s: float) -> Sample[Payload_co]:
        end = time.monotonic() + limit_s
        while (left := end - time.monotonic()) > 0.0:
            sample = self._next(min(left, POLL_S))
            if sample is not None:
                return sample
        raise self._gone(limit_s)

    def _counted(self, sample: Sample[Payload_co]) -> Sample[Payload_co]:
        self.counters.samples += 1
        return sample

    def _gone(self, limit_s: float) -> CaptureError:
        return CaptureError(
            f"no sample from UDP {self._socket.name} for {limit_s:g} s: check the device's power,"
            " the cable, the address and the port"
        )
