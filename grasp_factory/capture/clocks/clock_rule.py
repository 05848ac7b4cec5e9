"""Settings of the fit of a device's clock."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.serialization import check_range, normalise

NS = 1e9
"""Nanoseconds in a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClockRule:
    """When a clock has jumped, and how its drift is followed."""

    jump_s: float = 0.02
    """Smallest step of the device's clock against the host's that counts as a jump, seconds."""
    confirm_s: float = 5.0
    """Seconds for which samples must stay late, before the reason is taken for a jump.

    A host that is busy also makes samples late, but for a shorter time.
    """
    window_s: float = 15.0
    """Seconds over which the drift counts as constant."""
    max_drift_ppm: float = 1000.0
    """Largest drift, parts per million. Quartz stays below 100; the RC oscillator of an inertial
    sensor can have 30,000."""
    latency_s: float = 0.0
    """Delay of the fastest samples, seconds, from a calibration: the data cannot show it."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_range(self, "jump_s", 1e-4, 3600.0, "s")
        check_range(self, "confirm_s", 0.1, 3600.0, "s")
        check_range(self, "window_s", 1.0, 86400.0, "s")
        check_range(self, "max_drift_ppm", 1.0, 100_000.0, "ppm")
        check_range(self, "latency_s", 0.0, 10.0, "s")

    @property
    def max_drift(self) -> float:
        """The largest drift, seconds per second."""
        return self.max_drift_ppm * 1e-6
