"""What a store keeps of real episodes: rates and sizes of the arrays that only these fill."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from grasp_factory.core.config.within import Within, check_within
from grasp_factory.core.serialization import check, normalise

FASTEST_HZ = 20_000


@dataclass(frozen=True, slots=True, kw_only=True)
class CaptureConfig:
    """Room for real episodes beside the simulated ones.

    Rates are upper bounds: samples keep their own times. A rate of 0 leaves the arrays out.
    """

    force_torque_hz: Annotated[int, Within(0, FASTEST_HZ, "Hz")] = 0
    """Most samples per second of the force-torque sensor, Hz."""
    joints_hz: Annotated[int, Within(0, FASTEST_HZ, "Hz")] = 0
    """Most states per second of the joints and the gripper, Hz."""
    taxels_hz: Annotated[int, Within(0, FASTEST_HZ, "Hz")] = 0
    """Most frames per second of the tactile array, Hz."""
    imu_hz: Annotated[int, Within(0, FASTEST_HZ, "Hz")] = 0
    """Most samples per second of the IMU, Hz; 0 for the IMU's rate of the simulated episodes."""
    taxel_rows: Annotated[int, Within(1, 1024)] = 1
    """Rows of the tactile array."""
    taxel_columns: Annotated[int, Within(1, 1024)] = 1
    """Columns of the tactile array."""
    longest_s: Annotated[float, Within(0.1, 3600.0, "s")] = 30.0
    """Longest real episode, seconds."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ConfigError: naming the setting.
        """
        normalise(self)
        check_within(self)
        taxels = self.taxel_rows * self.taxel_columns
        check(taxels <= 65_536, "taxel_rows", self.taxel_rows, "up to 65,536 taxels in all")
