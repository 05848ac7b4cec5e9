"""A simulated Robotiq FT 300: it answers the request for its stream, then sends it."""

from __future__ import annotations

from threading import Event, Thread
from typing import Any, Self

from grasp_factory.capture.devices.robotiq_ft300 import (
    CRC,
    END_STREAM,
    HEADER,
    SCALES,
    START_STREAM,
    STREAM_STARTED,
    VALUES,
)
from grasp_factory.capture.samples import WrenchReading
from grasp_factory.capture.simulators.counts import counts
from grasp_factory.capture.simulators.serial_line import SimulatedSerialDevice
from grasp_factory.capture.simulators.tracks import DeviceTrack, wrench_track
from grasp_factory.core.episode import Episode

RATE_HZ = 100.0
_POLL_S = 0.02


class SimulatedRobotiqFt300(SimulatedSerialDevice[WrenchReading]):
    """Sends at 100 Hz, unless another rate is given, once it was asked to."""

    resolution = 0.5 * max(SCALES)

    def __init__(self, episode: Episode, **playing: Any) -> None:
        super().__init__(episode, **playing)
        self._is_streaming = Event()
        self._listener = Thread(target=self._listen, daemon=True)

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[WrenchReading]:
        """See ``SimulatedDevice.track_of``."""
        return wrench_track(episode, rate_hz or RATE_HZ)

    def play(self) -> None:
        """See ``SimulatedDevice.play``. It begins when its answer is sent, not before."""

    def packet(self, payload: WrenchReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedSerialDevice.packet``."""
        return CRC.sealed(HEADER + VALUES.pack(*counts(payload.wrench, SCALES, 16)))

    def send(self, place: int, number: int, device_ns: int) -> bool:
        """See ``SimulatedSender.send``."""
        return self._is_streaming.is_set() and super().send(place, number, device_ns)

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        self._is_streaming.clear()
        super().unplug()

    def __enter__(self) -> Self:
        super().__enter__()
        self._listener.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._leave.set()
        self._listener.join()
        super().__exit__(*error)

    def _listen(self) -> None:
        heard = b""
        while not self._leave.is_set():
            heard = (heard + self._line.read(_POLL_S))[-len(END_STREAM) :]
            if heard.endswith(END_STREAM):
                self._is_streaming.clear()
                heard = b""
            elif heard.endswith(START_STREAM):
                self._line.write(STREAM_STARTED, self._leave.is_set)
                self._is_streaming.set()
                super().play()
                heard = b""
