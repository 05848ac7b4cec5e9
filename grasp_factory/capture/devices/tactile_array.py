"""Driver of a tactile array over a serial line.

The frame is this package's own. All numbers are little-endian:

====================  =======  ====================================================
bytes                 type     meaning
====================  =======  ====================================================
0 to 1                         ``54 41``, the letters TA
2, 3                  uint8    rows, columns
4 to 7                uint32   number of the frame; it begins again at 0 after 2**32 - 1
8 to 11               uint32   microseconds of the array's clock; it wraps as well
12 ...                uint16   counts of the taxels, row by row
last 4                uint32   CRC-32 (as in zlib) of all bytes before it
====================  =======  ====================================================
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.serial_device import SerialDevice, SerialSettings
from grasp_factory.capture.samples import DeviceKind, Sample, TactileReading
from grasp_factory.capture.transport.checksums import CHECKSUMS
from grasp_factory.capture.transport.counting import SampleCount, UnwrappedClock
from grasp_factory.capture.transport.framing import PacketFormat
from grasp_factory.core.serialization import check, check_range

COUNTERS = struct.Struct("<II")
CRC = CHECKSUMS["crc32"]
_MARK = b"TA"
_VALUES_AT = len(_MARK) + 2 + COUNTERS.size
_US = 1000
"""Nanoseconds."""
_MOST_TAXELS = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class TactileArraySettings(SerialSettings):
    """The settings of the driver ``tactile_array``."""

    baudrate: int = 921_600
    rows: int = 8
    columns: int = 8
    scale: float = 1.0
    """Value of one count, in ``unit``."""
    offset: float = 0.0
    """Value at 0 counts, in ``unit``."""
    unit: str = "counts"
    """Unit of the recorded values, such as N or kPa."""

    def __post_init__(self) -> None:
        SerialSettings.__post_init__(self)
        check_range(self, "rows", 1, _MOST_TAXELS)
        check_range(self, "columns", 1, _MOST_TAXELS)
        check_range(self, "scale", 1e-12, 1e12)
        check_range(self, "offset", -1e12, 1e12)
        is_unit = 0 < len(self.unit) <= 40 and self.unit.isprintable()
        check(is_unit, "unit", self.unit, "a short text, such as N")

    @property
    def header(self) -> bytes:
        """The first bytes of every frame."""
        return _MARK + bytes([self.rows, self.columns])


class TactileArray(SerialDevice[TactileReading]):
    """The driver."""

    def __init__(self, settings: TactileArraySettings) -> None:
        self._shape = (settings.rows, settings.columns)
        self._scale, self._offset = settings.scale, settings.offset
        self._number, self._clock = SampleCount(bits=32), UnwrappedClock(bits=32)
        super().__init__(settings, packet_format(settings))

    def restart_stream(self) -> None:
        """See ``SerialDevice.restart_stream``."""
        self._number.restart()
        self._clock = UnwrappedClock(bits=32)

    def open(self) -> None:
        """See ``Device.open``."""
        self._number = SampleCount(bits=32)
        super().open()

    def decode(self, data: bytes, host_ns: int) -> Sample[TactileReading] | None:
        """See ``SerialDevice.decode``."""
        raw, time_us = COUNTERS.unpack_from(data, len(_MARK) + 2)
        sequence = self._number.number(raw)
        self.counters.lost = self._number.lost
        if sequence is None:
            return None
        counts = np.frombuffer(data, "<u2", self._shape[0] * self._shape[1], _VALUES_AT)
        pressure = counts.reshape(self._shape) * self._scale + self._offset
        return Sample(
            device_ns=self._clock.unwrap(time_us) * _US,
            host_ns=host_ns,
            sequence=sequence,
            payload=TactileReading(pressure=pressure),
        )


def packet_format(settings: TactileArraySettings) -> PacketFormat:
    """Return the format of the frames."""
    size = _VALUES_AT + 2 * settings.rows * settings.columns + CRC.size
    return PacketFormat(size=size, header=settings.header, has_checksum=CRC.fits)


TACTILE_ARRAY_MODEL = DeviceModel(
    name="tactile_array",
    kind=DeviceKind.TACTILE,
    description="array of taxels over a serial line, frames with a number, a clock and a CRC-32",
    settings=TactileArraySettings,
    implementation="grasp_factory.capture.devices.tactile_array:TactileArray",
    simulator="grasp_factory.capture.simulators.tactile_array:SimulatedTactileArray",
    modules=("serial",),
    extra="serial",
)
