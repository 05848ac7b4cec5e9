"""Driver of a Bosch BMI088 behind a microcontroller that sends packets of 17 bytes.

A packet: ``55 AA``, three int16 of specific force, three of angular velocity, one of temperature,
all little-endian, and a checksum of one byte. There is no clock and no count of samples.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import partial

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.serial_device import SerialDevice, SerialSettings
from grasp_factory.capture.samples import DeviceKind, InertialReading, Sample
from grasp_factory.capture.transport.checksums import CHECKSUMS, Checksum
from grasp_factory.capture.transport.framing import PacketFormat
from grasp_factory.core.serialization import check, check_range

HEADER = b"\x55\xaa"
VALUES = struct.Struct("<7h")
SIZE = 17
_ONE_BYTE = tuple(name for name, checksum in CHECKSUMS.items() if checksum.size == 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bmi088Settings(SerialSettings):
    """The settings of the driver ``bmi088``. Scales are the physical value of one count."""

    specific_force_scale: float = 0.001
    """m/s2."""
    angular_velocity_scale: float = 0.001
    """rad/s."""
    temperature_scale: float = 0.01
    """Degrees Celsius."""
    temperature_offset: float = 0.0
    """Degrees Celsius at 0 counts. The chip's own counts have 23 and a scale of 0.125."""
    checksum: str = "sum8"
    """Name of the checksum's algorithm."""
    checksum_start: int = 2
    """First byte that the checksum covers: 2, or 0 for the header too."""
    largest_specific_force: float | None = None
    """m/s2; packets with a component beyond it are refused. None refuses none."""
    largest_angular_velocity: float | None = None
    """rad/s; packets with a component beyond it are refused. None refuses none."""
    temperature_range: tuple[float, float] | None = None
    """Degrees Celsius; packets outside of it are refused. None refuses none."""

    def __post_init__(self) -> None:
        SerialSettings.__post_init__(self)
        for name in ("specific_force_scale", "angular_velocity_scale", "temperature_scale"):
            check_range(self, name, 1e-9, 1e3)
        check_range(self, "temperature_offset", -300.0, 300.0)
        valid = ", ".join(_ONE_BYTE)
        check(self.checksum in _ONE_BYTE, "checksum", self.checksum, valid)
        check(self.checksum_start in (0, 2), "checksum_start", self.checksum_start, "0 or 2")
        for name in ("largest_specific_force", "largest_angular_velocity"):
            if getattr(self, name) is not None:
                check_range(self, name, 1e-6, 1e6)
        if self.temperature_range is not None:
            low, high = self.temperature_range
            ascends = low < high
            check(ascends, "temperature_range", self.temperature_range, "the lower value first")

    @property
    def algorithm(self) -> Checksum:
        """The checksum's algorithm."""
        return CHECKSUMS[self.checksum]


class Bmi088(SerialDevice[InertialReading]):
    """The driver."""

    def __init__(self, settings: Bmi088Settings) -> None:
        force, rate = settings.specific_force_scale, settings.angular_velocity_scale
        self._scales = np.array([force] * 3 + [rate] * 3)
        self._temperature = (settings.temperature_scale, settings.temperature_offset)
        super().__init__(settings, packet_format(settings))

    def decode(self, data: bytes, host_ns: int) -> Sample[InertialReading]:
        """See ``SerialDevice.decode``."""
        counts = VALUES.unpack_from(data, len(HEADER))
        values = np.array(counts[:6]) * self._scales
        scale, offset = self._temperature
        reading = InertialReading(
            specific_force=values[:3],
            angular_velocity=values[3:],
            temperature=counts[6] * scale + offset,
        )
        return Sample(device_ns=None, host_ns=host_ns, sequence=None, payload=reading)


def packet_format(settings: Bmi088Settings) -> PacketFormat:
    """Return the format of the packets, with the checks that the settings ask for."""
    fits = partial(settings.algorithm.fits, start=settings.checksum_start)
    ranges = _ranges(settings)

    def is_plausible(packet: bytes) -> bool:
        counts = VALUES.unpack_from(packet, len(HEADER))
        return all(low <= counts[k] <= high for k, low, high in ranges)

    return PacketFormat(size=SIZE, header=HEADER, has_checksum=fits, is_plausible=is_plausible)


def _ranges(settings: Bmi088Settings) -> list[tuple[int, float, float]]:
    """Return place, lowest and highest count of the values that are checked."""
    found = []
    for first, largest, scale in (
        (0, settings.largest_specific_force, settings.specific_force_scale),
        (3, settings.largest_angular_velocity, settings.angular_velocity_scale),
    ):
        if largest is not None:
            found += [(k, -largest / scale, largest / scale) for k in range(first, first + 3)]
    if settings.temperature_range is not None:
        offset, scale = settings.temperature_offset, settings.temperature_scale
        low, high = ((value - offset) / scale for value in settings.temperature_range)
        found.append((6, low, high))
    return found


BMI088_MODEL = DeviceModel(
    name="bmi088",
    kind=DeviceKind.IMU,
    description="Bosch BMI088 over a serial line, packets of 17 bytes with a checksum",
    settings=Bmi088Settings,
    implementation="grasp_factory.capture.devices.bmi088:Bmi088",
    simulator="grasp_factory.capture.simulators.bmi088:SimulatedBmi088",
    modules=("serial",),
    extra="serial",
)
