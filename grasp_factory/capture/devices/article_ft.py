"""Driver of a force-torque sensor that sends six float32, little-endian, and nothing else.

Without header and checksum, only the values tell where a frame begins: after a lost byte they have
absurd exponents. So a frame is taken if its values are plausible and those of the next frame too.
After four lost bytes all values are plausible, but each stands in the place of its neighbour: then
the frame that continues the last values wins. Of a sensor without load, that cannot be told.
Prefer a protocol with a checksum where there is a choice.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.serial_device import SerialDevice, SerialSettings
from grasp_factory.capture.samples import DeviceKind, Sample, WrenchReading
from grasp_factory.capture.transport.framing import PacketFormat
from grasp_factory.core.serialization import check, check_range
from grasp_factory.signals.noise.wrench import Six
from grasp_factory.signals.wrench import calibrate

VALUES = struct.Struct("<6f")
_UNIT = tuple(tuple(float(row == column) for column in range(6)) for row in range(6))


@dataclass(frozen=True, slots=True, kw_only=True)
class ArticleFtSettings(SerialSettings):
    """The settings of the driver ``article_ft``. Raw values are in the unit that it sends."""

    baudrate: int = 921_600
    largest: Six = (145.0, 145.0, 290.0, 5.0, 5.0, 5.0)
    """Largest magnitude of each raw value: the range of the ATI Mini45 (SI-145-5), N and N m."""
    largest_step: Six = (5.0, 5.0, 5.0, 0.25, 0.25, 0.25)
    """Change between two frames up to which they follow each other without doubt. A larger one
    is doubted only if frames that begin elsewhere would follow better."""
    smallest: float = 1e-6
    """Smallest magnitude of a raw value that is not 0: less is no measurement, but a shifted
    frame."""
    bias: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """Raw values without load."""
    matrix: tuple[Six, Six, Six, Six, Six, Six] = _UNIT  # type: ignore[assignment]
    """N and N m per raw unit: the wrench is ``matrix @ (raw - bias)``."""

    def __post_init__(self) -> None:
        SerialSettings.__post_init__(self)
        check(min(self.largest) > 0.0, "largest", self.largest, "six numbers above 0")
        steps = self.largest_step
        check(min(steps) > 0.0, "largest_step", steps, "six numbers above 0")
        check_range(self, "smallest", 0.0, min(self.largest))


class ArticleFt(SerialDevice[WrenchReading]):
    """The driver."""

    def __init__(self, settings: ArticleFtSettings) -> None:
        self._calibration = (np.array(settings.matrix), np.array(settings.bias))
        super().__init__(settings, packet_format(settings))

    def decode(self, data: bytes, host_ns: int) -> Sample[WrenchReading]:
        """See ``SerialDevice.decode``."""
        raw = np.array(VALUES.unpack(data))
        reading = WrenchReading(wrench=calibrate(raw, *self._calibration))
        return Sample(device_ns=None, host_ns=host_ns, sequence=None, payload=reading)


def packet_format(settings: ArticleFtSettings) -> PacketFormat:
    """Return the format of the frames."""
    largest, smallest = settings.largest, settings.smallest

    def is_plausible(packet: bytes) -> bool:
        return all(
            value == 0.0 or smallest <= abs(value) <= most
            for value, most in zip(VALUES.unpack(packet), largest, strict=True)
        )

    def continues(before: bytes, packet: bytes) -> bool:
        pairs = zip(
            VALUES.unpack(before), VALUES.unpack(packet), settings.largest_step, strict=True
        )
        return all(abs(now - last) <= most for last, now, most in pairs)

    return PacketFormat(size=VALUES.size, is_plausible=is_plausible, continues=continues)


ARTICLE_FT_MODEL = DeviceModel(
    name="article_ft",
    kind=DeviceKind.FORCE_TORQUE,
    description="force-torque sensor that sends six float32 over a serial line, without a header",
    settings=ArticleFtSettings,
    implementation="grasp_factory.capture.devices.article_ft:ArticleFt",
    simulator="grasp_factory.capture.simulators.article_ft:SimulatedArticleFt",
    modules=("serial",),
    extra="serial",
)
