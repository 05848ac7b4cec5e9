"""What goes wrong in a simulated device, and how packets are spoilt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.serialization import check_range


@dataclass(frozen=True, slots=True, kw_only=True)
class Faults:
    """The faults of a simulated device. Shares are of its samples, and do not overlap."""

    dropped_bytes: float = 0.0
    """Share of packets that lose one to four bytes."""
    bad_checksums: float = 0.0
    """Share of packets with a wrong last byte."""
    garbage: float = 0.0
    """Share of packets in whose place random bytes come."""
    lost: float = 0.0
    """Share of samples that the device counts, but does not send."""
    batch_s: float = 0.0
    """Samples are held back, and sent together each such time, as a USB adapter does (16 ms)."""
    frozen_after_s: float | None = None
    """From then on a camera repeats its image."""
    counter_start: int = 0
    """First number of the device's count; 2**32 - 10 lets it wrap after ten samples."""
    clock_ppm: float = 0.0
    """How much faster the device's clock runs than the host's, millionths."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the value.
        """
        for name in ("dropped_bytes", "bad_checksums", "garbage", "lost"):
            check_range(self, name, 0.0, 1.0)
        check_range(self, "batch_s", 0.0, 10.0, "s")
        check_range(self, "counter_start", 0, 2**32 - 1)
        check_range(self, "clock_ppm", -1e5, 1e5)


NO_FAULTS = Faults()


@dataclass(frozen=True, slots=True)
class SpoiltPacket:
    """The bytes that are sent for a packet."""

    data: bytes
    is_clean: bool


class Spoiler:
    """Spoils packets as ``Faults`` says, the same ones for the same seed."""

    def __init__(self, faults: Faults) -> None:
        self._faults, self._rng = faults, np.random.default_rng(faults.seed)

    def is_lost(self) -> bool:
        """Return whether the next sample is not sent."""
        return bool(self._faults.lost) and self._rng.random() < self._faults.lost

    def spoilt(self, packet: bytes) -> SpoiltPacket:
        """Return what is sent for a packet."""
        faults, chance = self._faults, self._rng.random()
        if chance < faults.dropped_bytes:
            return SpoiltPacket(self._shortened(packet), False)
        chance -= faults.dropped_bytes
        if chance < faults.bad_checksums:
            wrong = packet[-1] ^ int(self._rng.integers(1, 256))
            return SpoiltPacket(packet[:-1] + bytes([wrong]), False)
        chance -= faults.bad_checksums
        if chance < faults.garbage:
            length = int(self._rng.integers(1, 2 * len(packet)))
            return SpoiltPacket(self._rng.bytes(length), False)
        return SpoiltPacket(packet, True)

    def _shortened(self, packet: bytes) -> bytes:
        count = int(self._rng.integers(1, 5))
        gone = set(self._rng.choice(len(packet), min(count, len(packet)), replace=False).tolist())
        return bytes(byte for place, byte in enumerate(packet) if place not in gone)
