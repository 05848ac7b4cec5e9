"""A simulated sensor of six floats: the wrist's wrench of an episode, without header."""

from __future__ import annotations

from grasp_factory.capture.devices.article_ft import VALUES
from grasp_factory.capture.samples import WrenchReading
from grasp_factory.capture.simulators.serial_line import SimulatedSerialDevice
from grasp_factory.capture.simulators.tracks import DeviceTrack, wrench_track
from grasp_factory.core.episode import Episode


class SimulatedArticleFt(SimulatedSerialDevice[WrenchReading]):
    """Sends newtons and newton metres."""

    resolution = 1e-4
    """Of float32, at 1000 N."""

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[WrenchReading]:
        """See ``SimulatedDevice.track_of``."""
        return wrench_track(episode, rate_hz)

    def packet(self, payload: WrenchReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedSerialDevice.packet``."""
        return VALUES.pack(*payload.wrench)
