"""Checksums of serial protocols."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from operator import xor


@dataclass(frozen=True, slots=True, kw_only=True)
class Checksum:
    """A way to compute the last bytes of a packet from the bytes before them."""

    size: int
    """Bytes."""
    of: Callable[[bytes], bytes]

    def fits(self, packet: bytes, start: int = 0) -> bool:
        """Return whether a packet ends with the checksum of its bytes from ``start`` on."""
        body = len(packet) - self.size
        return packet[body:] == self.of(packet[start:body])

    def sealed(self, body: bytes, start: int = 0) -> bytes:
        """Return a body with its checksum behind it."""
        return body + self.of(body[start:])


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16 of Modbus over serial lines (V1.02, 6.2.2): 0xA001, starting at 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = (crc >> 8) ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


def _modbus_entry(index: int) -> int:
    return reduce(lambda crc, _: (crc >> 1) ^ (0xA001 if crc & 1 else 0), range(8), index)


_MODBUS = tuple(map(_modbus_entry, range(256)))


CHECKSUMS: Mapping[str, Checksum] = {
    "none": Checksum(size=0, of=lambda data: b""),
    "sum8": Checksum(size=1, of=lambda data: bytes([sum(data) & 0xFF])),
    "negative_sum8": Checksum(size=1, of=lambda data: bytes([-sum(data) & 0xFF])),
    "xor8": Checksum(size=1, of=lambda data: bytes([reduce(xor, data, 0)])),
    "crc16_modbus": Checksum(size=2, of=lambda data: crc16_modbus(data).to_bytes(2, "little")),
    "crc32": Checksum(size=4, of=lambda data: zlib.crc32(data).to_bytes(4, "little")),
}
"""By the name that a setting gives. ``sum8`` is the sum of the bytes modulo 256."""
