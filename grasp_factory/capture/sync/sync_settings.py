"""Settings of synchronisation: slop, method, and how far apart two streams may be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from grasp_factory.core.serialization import check, check_range, normalise
from grasp_factory.errors import ConfigError

VISUAL_INERTIAL_S = 0.001
"""Usual tolerance of a camera and an inertial sensor, seconds."""


class SyncMethod(Enum):
    """How samples of several streams are brought together."""

    SETS = 0
    """Recorded samples that are near each other, by ROS's ApproximateTime policy."""
    INTERPOLATE = 1
    """Values between the samples, at the times of the reference stream."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncSettings:
    """How streams are brought together, and what is reported as missed."""

    method: SyncMethod = SyncMethod.SETS
    reference: str = ""
    """The stream whose times are used; needed for ``interpolate``."""
    slop_s: float = 0.1
    """Longest span of a set, seconds; for ``interpolate`` the longest gap between samples."""
    tolerances_s: Mapping[str, float] = field(default_factory=dict)
    """Largest distance by pair of streams, such as ``{"camera-imu": 0.001}``, seconds."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_range(self, "slop_s", 1e-6, 3600.0, "s")
        for name, value in self.tolerances_s.items():
            check(0.0 < value <= 3600.0, f"tolerances_s.{name}", value, "above 0 to 3600 s")
        needs = self.method is SyncMethod.INTERPOLATE
        check(bool(self.reference) or not needs, "reference", self.reference, "a stream's name")

    def tolerance_of(self, pair: str) -> float | None:
        """Return the tolerance of a pair in either order, seconds; None for no bound."""
        for name, value in self.tolerances_s.items():
            if _sorted_pair(name) == _sorted_pair(pair):
                return value
        return None

    def check_streams(self, streams: Iterable[str]) -> None:
        """Check that all streams which the settings name are there.

        Raises:
            ConfigError: naming the key.
        """
        names = list(streams)
        pairs = {_sorted_pair(pair_name(a, b)) for a in names for b in names if a != b}
        for name in self.tolerances_s:
            if _sorted_pair(name) not in pairs:
                valid = ", ".join("-".join(pair) for pair in sorted(pairs)) or "none"
                raise ConfigError(f"tolerances_s: got {name!r}, valid: {valid}")
        if self.reference and self.reference not in names:
            raise ConfigError(f"reference: got {self.reference!r}, valid: {', '.join(names)}")


def pair_name(first: str, second: str) -> str:
    """Return the name of a pair of streams."""
    return f"{first}-{second}"


def _sorted_pair(name: str) -> tuple[str, ...]:
    return tuple(sorted(name.split("-")))
