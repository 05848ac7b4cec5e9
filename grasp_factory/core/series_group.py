"""Groups of time series in a store: each has a clock, a rate and a length of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from grasp_factory.core.config.capture import CaptureConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.field import Field, field

if TYPE_CHECKING:
    from grasp_factory.core.config.factory_config import FactoryConfig


class Rates(Protocol):
    """The settings that a rate may depend on; both configs and recipes have them."""

    @property
    def record_hz(self) -> int:
        """Rate of the streams, Hz."""

    @property
    def imu_rate(self) -> int:
        """Rate of the IMU, Hz."""

    @property
    def video_hz(self) -> int:
        """Rate of the videos, Hz; 0 for no videos."""

    @property
    def physics(self) -> PhysicsConfig:
        """Rates of the simulation steps."""

    @property
    def capture(self) -> CaptureConfig | None:
        """What stores keep of real episodes; None in recipes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeriesGroup:
    """Time series that share a clock: a group of the store, with the array ``timestamp``."""

    name: str
    """Path of the group in the store."""
    title: str
    """What the length column counts, as in "valid length of the streams"."""
    dim: str
    """Letter of the sample dimension in ``Field.dims``; no other group or dimension uses it."""
    dimension_name: str
    """Name of that dimension in the store's arrays."""
    count: str
    """Name of the column with the number of samples."""
    rate: Callable[[Rates], int]
    """Returns samples per second, a divisor of both physics rates; 0 to leave the group out."""
    is_real: bool = False
    """Whether only real episodes have samples in it; its rate is then the highest one."""
    capacity: Callable[[FactoryConfig], int] | None = None
    """Returns the largest number of samples of an attempt.

    None for the rate times the longest attempt.
    """

    @property
    def length_column(self) -> str:
        """Path of the column with the number of samples."""
        return f"episodes/{self.count}"

    def longest(self, config: FactoryConfig) -> int:
        """Return an upper bound for the number of samples of an attempt."""
        if self.capacity:
            return self.capacity(config)
        return math.ceil(config.longest_s * self.rate(config))

    def series(
        self, name: str, dims: tuple[str | int, ...], dtype: str, description: str, **more: Any
    ) -> Field:
        """Return the field of a time series, whose samples have the dimensions ``dims``."""
        path, length = f"{self.name}/{name}", self.length_column
        return field(path, (self.dim, *dims), dtype, description, length_column=length, **more)

    def constant(
        self, name: str, dims: tuple[str | int, ...], dtype: str, description: str, **more: Any
    ) -> Field:
        """Return the field of an array that has one value per attempt."""
        return field(f"{self.name}/{name}", dims, dtype, description, **more)
