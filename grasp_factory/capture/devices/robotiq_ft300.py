"""Driver of a Robotiq FT 300 over a serial line.

A frame: ``20 4E``, six int16, little-endian, in 0.01 N and 0.001 N m, and the CRC-16 of Modbus. The
stream begins when 0x0200 is written to register 410, and ends after fifty bytes of FF (Robotiq, FT
300 instruction manual, data stream).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.serial_device import SerialDevice, SerialSettings
from grasp_factory.capture.samples import DeviceKind, Sample, WrenchReading
from grasp_factory.capture.transport.checksums import CHECKSUMS
from grasp_factory.capture.transport.framing import PacketFormat
from grasp_factory.errors import CaptureError

HEADER = b"\x20\x4e"
VALUES = struct.Struct("<6h")
SCALES = (0.01, 0.01, 0.01, 0.001, 0.001, 0.001)
CRC = CHECKSUMS["crc16_modbus"]
FORMAT = PacketFormat(
    size=len(HEADER) + VALUES.size + CRC.size, header=HEADER, has_checksum=CRC.fits
)
END_STREAM = b"\xff" * 50
START_STREAM = CRC.sealed(bytes.fromhex("09 10 01 9A 00 01 02 02 00"))
"""Modbus: device 9 shall write one register, 410, with 0x0200."""
STREAM_STARTED = CRC.sealed(bytes.fromhex("09 10 01 9A 00 01"))
_QUIET_S, _ANSWER_S = 0.05, 1.0
_ANSWER_TRIES = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotiqFt300Settings(SerialSettings):
    """The settings of the driver ``robotiq_ft300``."""

    baudrate: int = 19_200
    starts_stream: bool = True
    """Whether the driver asks for the stream; false if the sensor sends by itself."""


class RobotiqFt300(SerialDevice[WrenchReading]):
    """The driver."""

    def __init__(self, settings: RobotiqFt300Settings) -> None:
        self._starts_stream = settings.starts_stream
        super().__init__(settings, FORMAT)

    def start_stream(self) -> bytes:
        """See ``SerialDevice.start_stream``."""
        if not self._starts_stream:
            return b""
        self._port.write(END_STREAM)
        self._port.read_after(END_STREAM, _QUIET_S)  # waits, and drops the rest of an old stream
        for _ in range(_ANSWER_TRIES):
            self._port.write(START_STREAM)
            stream = self._port.read_after(STREAM_STARTED, _ANSWER_S / _ANSWER_TRIES)
            if stream is not None:
                return stream
        raise CaptureError(
            f"the FT 300 at {self._settings.port} does not answer: check its power, the port and"
            f" the baud rate ({self._settings.baudrate})"
        )

    def decode(self, data: bytes, host_ns: int) -> Sample[WrenchReading]:
        """See ``SerialDevice.decode``."""
        wrench = np.array(VALUES.unpack_from(data, len(HEADER))) * SCALES
        reading = WrenchReading(wrench=wrench)
        return Sample(device_ns=None, host_ns=host_ns, sequence=None, payload=reading)


ROBOTIQ_FT300_MODEL = DeviceModel(
    name="robotiq_ft300",
    kind=DeviceKind.FORCE_TORQUE,
    description="Robotiq FT 300 over a serial line, its data stream at 100 Hz",
    settings=RobotiqFt300Settings,
    implementation="grasp_factory.capture.devices.robotiq_ft300:RobotiqFt300",
    simulator="grasp_factory.capture.simulators.robotiq_ft300:SimulatedRobotiqFt300",
    modules=("serial",),
    extra="serial",
)
