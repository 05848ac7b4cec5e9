"""From when on a stream raises an alarm."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check_range, normalise

_RANGES = {
    "window_s": (1.0, 60.0, "s"),
    "rate": (0.001, 10.0, ""),
    "gap_s": (0.001, 600.0, "s"),
    "gap_periods": (1.0, 10_000.0, ""),
    "frozen_s": (0.05, 600.0, "s"),
    "saturated": (0.0, 1.0, ""),
    "clipped": (0.0, 1.0, ""),
    "bad_checksums": (0.0, 1.0, ""),
    "clock_jump_s": (0.0001, 600.0, "s"),
    "clock_drift_ppm": (1.0, 1e6, "ppm"),
    "queue": (0.01, 1.0, ""),
    "disk_s": (1.0, 86_400.0, "s"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """Limits of the live checks."""

    window_s: float = 5.0
    """Latest seconds that are looked at."""
    rate: float = 0.1
    """Share by which the rate may differ from the expected one."""
    gap_s: float = 0.1
    """Longest time without a sample, unless ``gap_periods`` take longer."""
    gap_periods: float = 5.0
    """Longest time without a sample, in periods of the expected rate."""
    frozen_s: float = 1.0
    """Longest time for which the values of a camera, an IMU or a force sensor may not change."""
    saturated: float = 0.01
    """Share of samples that may be at full scale."""
    clipped: float = 0.5
    """Share of an image's pixels that may be completely black or white."""
    bad_checksums: float = 0.01
    """Share of packets that may be damaged."""
    clock_jump_s: float = 0.05
    """Change of the device's clock against this machine's, from one second to the next."""
    clock_drift_ppm: float = 500.0
    """Speed of the device's clock against this machine's; a cheap crystal has 100 ppm."""
    queue: float = 0.5
    """Share of the queue to the disk that may be full."""
    disk_s: float = 120.0
    """Seconds of recording that should still fit on the disk."""

    def __post_init__(self) -> None:
        normalise(self)
        for key, (low, high, unit) in _RANGES.items():
            check_range(self, key, low, high, unit)
