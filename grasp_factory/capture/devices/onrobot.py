"""Driver of an OnRobot HEX force-torque sensor with its Compute Box, over UDP.

It speaks RDT with commands of its own (OnRobot, Compute Box manual, UDP interface): 0x82 sets the
period, 0x81 the filter, 0x42 the zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.rdt import RdtSensor, RdtSettings
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.core.serialization import check_range

SCALES = (1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-5)
"""N and N m of one count."""
SET_PERIOD, SET_FILTER, SET_BIAS = 0x0082, 0x0081, 0x0042
_BIAS_ON = 255


@dataclass(frozen=True, slots=True, kw_only=True)
class OnRobotSettings(RdtSettings):
    """The settings of the driver ``onrobot``."""

    period_ms: int = 2
    """Time between two samples, ms."""
    filter: int = 0
    """The sensor's low-pass filter: 0 for none, 1 (500 Hz) to 6 (1.5 Hz)."""
    sets_bias: bool = False
    """Whether the reading at the start becomes the sensor's zero."""

    def __post_init__(self) -> None:
        RdtSettings.__post_init__(self)
        check_range(self, "period_ms", 1, 254, "ms")
        check_range(self, "filter", 0, 6)


class OnRobot(RdtSensor):
    """The driver."""

    def __init__(self, settings: OnRobotSettings) -> None:
        commands = ((SET_PERIOD, settings.period_ms), (SET_FILTER, settings.filter))
        bias = ((SET_BIAS, _BIAS_ON),) if settings.sets_bias else ()
        super().__init__(settings, (*commands, *bias), np.array(SCALES), 0.0)


ONROBOT_MODEL = DeviceModel(
    name="onrobot",
    kind=DeviceKind.FORCE_TORQUE,
    description="OnRobot HEX force-torque sensor with a Compute Box, over UDP",
    settings=OnRobotSettings,
    implementation="grasp_factory.capture.devices.onrobot:OnRobot",
    simulator="grasp_factory.capture.simulators.rdt:SimulatedOnRobot",
)
