"""A simulated BMI088: the IMU of an episode as packets of 17 bytes."""

from __future__ import annotations

from grasp_factory.capture.devices.bmi088 import HEADER, VALUES, Bmi088Settings
from grasp_factory.capture.samples import InertialReading
from grasp_factory.capture.simulators.counts import counts
from grasp_factory.capture.simulators.serial_line import SimulatedSerialDevice
from grasp_factory.capture.simulators.tracks import DeviceTrack, imu_track
from grasp_factory.capture.transport.checksums import CHECKSUMS
from grasp_factory.core.episode import Episode

_DEFAULTS = Bmi088Settings(port="-")


class SimulatedBmi088(SimulatedSerialDevice[InertialReading]):
    """Sends with the driver's default scales and checksum."""

    resolution = 0.5 * _DEFAULTS.specific_force_scale

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[InertialReading]:
        """See ``SimulatedDevice.track_of``."""
        return imu_track(episode, rate_hz)

    def packet(self, payload: InertialReading, number: int, device_ns: int) -> bytes:
        """See ``SimulatedSerialDevice.packet``."""
        return packet(payload)


def packet(reading: InertialReading) -> bytes:
    """Return the packet of a reading."""
    values = VALUES.pack(
        *counts(reading.specific_force, _DEFAULTS.specific_force_scale, 16),
        *counts(reading.angular_velocity, _DEFAULTS.angular_velocity_scale, 16),
        *counts(reading.temperature, _DEFAULTS.temperature_scale, 16),
    )
    start = _DEFAULTS.checksum_start
    return CHECKSUMS[_DEFAULTS.checksum].sealed(HEADER + values, start)
