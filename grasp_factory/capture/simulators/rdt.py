"""Simulated sensors over RDT: the wrist's wrench of an episode, sent to whoever asks for it."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Thread
from typing import Any, Self

from grasp_factory.capture.devices import onrobot
from grasp_factory.capture.devices.ati_net_ft import AtiNetFtSettings
from grasp_factory.capture.devices.rdt import MAGIC, RECORD, REQUEST, START, STOP
from grasp_factory.capture.samples import WrenchReading
from grasp_factory.capture.simulators.counts import counts
from grasp_factory.capture.simulators.datagrams import LOOPBACK, SimulatedUdpDevice, free_port
from grasp_factory.capture.simulators.tracks import DeviceTrack, wrench_track
from grasp_factory.core.episode import Episode

_POLL_S = 0.005
_NS = 10**9
_ATI = AtiNetFtSettings(host=LOOPBACK)


class SimulatedRdtSensor(SimulatedUdpDevice[WrenchReading]):
    """Sends to whoever asked for the stream last."""

    scales: tuple[float, ...]
    sample_hz = 0.0

    def __init__(self, episode: Episode, **playing: Any) -> None:
        super().__init__(episode, **playing)
        self._port = free_port()
        self._to: tuple[str, int] | None = None
        self._listener = Thread(target=self._listen, daemon=True)

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        return {"host": LOOPBACK, "port": self._port}

    def bound(self) -> tuple[str, int]:
        """See ``SimulatedUdpDevice.bound``."""
        return LOOPBACK, self._port

    def receiver(self) -> tuple[str, int] | None:
        """See ``SimulatedUdpDevice.receiver``."""
        return self._to

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[WrenchReading]:
        """See ``SimulatedDevice.track_of``."""
        return wrench_track(episode, rate_hz)

    def datagram(self, payload: WrenchReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedUdpDevice.datagram``."""
        sample = round(device_ns * self.sample_hz / _NS) % 2**32
        values = counts(payload.wrench, self.scales, 32)
        return RECORD.pack(number % 2**32, sample, 0, *values)

    def unplug(self) -> None:
        """See ``SimulatedDevice.unplug``."""
        self._to = None
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
        while not self._leave.wait(_POLL_S):
            found = self.heard()
            if found is None or len(found[0]) != REQUEST.size:
                continue
            magic, command, _ = REQUEST.unpack(found[0])
            if magic == MAGIC and command == START:
                self._to = found[1]
                self.play()
            elif magic == MAGIC and command == STOP:
                self._to = None


class SimulatedAtiNetFt(SimulatedRdtSensor):
    """An ATI sensor with a Net Box that has the driver's default counts."""

    scales = _ATI.scales
    sample_hz = _ATI.sample_hz
    resolution = max(_ATI.scales)


class SimulatedOnRobot(SimulatedRdtSensor):
    """An OnRobot sensor."""

    scales = onrobot.SCALES
    resolution = max(onrobot.SCALES)
