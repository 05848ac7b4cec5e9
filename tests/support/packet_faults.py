"""Streams of packets with faults, and what a framer made of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices import article_ft, bmi088
from grasp_factory.capture.samples import InertialReading, WrenchReading
from grasp_factory.capture.simulators.bmi088 import packet as imu_packet
from grasp_factory.capture.simulators.faults import Faults, Spoiler
from grasp_factory.capture.transport.framing import Framer, PacketFormat

PLAIN = bmi088.Bmi088Settings(port="-")
CHECKED = bmi088.Bmi088Settings(
    port="-",
    largest_specific_force=30.0,
    largest_angular_velocity=10.0,
    temperature_range=(15.0, 45.0),
)
"""With the plausibility check of ``bmi088``."""
BMI088_PLAIN, BMI088_CHECKED = map(bmi088.packet_format, (PLAIN, CHECKED))
ARTICLE_FT = article_ft.packet_format(article_ft.ArticleFtSettings(port="-"))


@dataclass(frozen=True, kw_only=True)
class FaultFigures:
    """What came of a stream."""

    clean: int
    """Packets that were sent as they are."""
    kept: int
    """Of these, how many were accepted."""
    false_accepts: int
    """Accepted packets that were not sent like this."""

    def __add__(self, other: FaultFigures) -> FaultFigures:
        return FaultFigures(
            clean=self.clean + other.clean,
            kept=self.kept + other.kept,
            false_accepts=self.false_accepts + other.false_accepts,
        )


def thirds(share: float, seed: int, **more: float) -> Faults:
    """Return faults of a share of packets: lost bytes, bad checksums and garbage alike."""
    third = share / 3.0
    return Faults(
        dropped_bytes=third,
        bad_checksums=third,
        garbage=third,
        seed=seed,
        **more,  # type: ignore[arg-type]
    )


def imu_packets(count: int, seed: int) -> list[bytes]:
    """Return packets of an IMU, each different from all others nearby."""
    rng = np.random.default_rng([seed, 0])
    force = np.array([0.0, 0.0, 9.81]) + 2.0 * rng.standard_normal((count, 3))
    rate = 0.5 * rng.standard_normal((count, 3))
    return [
        imu_packet(InertialReading(specific_force=f, angular_velocity=w, temperature=25.0))
        for f, w in zip(force, rate, strict=True)
    ]


def wrench_frames(count: int, seed: int) -> list[bytes]:
    """Return frames of six floats: a load that changes slowly, and noise."""
    rng = np.random.default_rng([seed, 1])
    swing = np.sin(np.arange(count)[:, None] * (2e-3 * np.arange(1, 7)))
    load = np.array([-4.0, 6.0, -15.0, 0.4, -0.7, 0.2]) * (1.0 + 0.3 * swing)
    wrenches = load + rng.standard_normal((count, 6)) * (0.06, 0.06, 0.06, 1e-3, 1e-3, 1e-3)
    readings = (WrenchReading(wrench=wrench) for wrench in wrenches)
    return [article_ft.VALUES.pack(*reading.wrench) for reading in readings]


def spoilt(packets: Iterable[bytes], faults: Faults) -> tuple[bytes, list[bytes]]:
    """Return a stream, and the packets in it that are clean."""
    spoiler = Spoiler(faults)
    sent = [(packet, spoiler.spoilt(packet)) for packet in packets]
    stream = b"".join(found.data for _, found in sent)
    return stream, [packet for packet, found in sent if found.is_clean]


def compared(clean: list[bytes], accepted: list[bytes]) -> FaultFigures:
    """Return how accepted packets compare with those that were sent clean."""
    known, found = set(clean), set(accepted)
    return FaultFigures(
        clean=len(clean),
        kept=sum(packet in found for packet in clean),
        false_accepts=sum(packet not in known for packet in accepted),
    )


def framed(
    packets: list[bytes], format: PacketFormat, faults: Faults, piece: int = 64
) -> tuple[FaultFigures, Framer]:
    """Return what a framer finds in a stream that arrives in pieces."""
    stream, clean = spoilt(packets, faults)
    framer = Framer(format)
    found = []
    for start in range(0, len(stream), piece):
        found += framer.feed(stream[start : start + piece])
    found += framer.finish()
    return compared(clean, [packet.data for packet in found]), framer
