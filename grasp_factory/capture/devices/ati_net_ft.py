"""Driver of an ATI force-torque sensor with a Net Box, by RDT over UDP.

ATI, Network Force/Torque Sensor System manual, "UDP interface using RDT".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.capture.devices.base import DeviceModel
from grasp_factory.capture.devices.rdt import RdtSensor, RdtSettings
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.core.serialization import check_range

SET_BIAS = 0x0042


@dataclass(frozen=True, slots=True, kw_only=True)
class AtiNetFtSettings(RdtSettings):
    """The settings of the driver ``ati_net_ft``. The Net Box's page shows the counts."""

    counts_per_force: float = 1_000_000.0
    """Counts per newton."""
    counts_per_torque: float = 1_000_000.0
    """Counts per newton metre."""
    sample_hz: float = 7000.0
    """Rate of the Net Box's own samples; their number is the clock. 0: the device has no clock."""
    sets_bias: bool = False
    """Whether the reading at the start becomes the sensor's zero."""

    def __post_init__(self) -> None:
        RdtSettings.__post_init__(self)
        check_range(self, "counts_per_force", 1e-3, 1e12)
        check_range(self, "counts_per_torque", 1e-3, 1e12)
        check_range(self, "sample_hz", 0.0, 1e6, "Hz")

    @property
    def scales(self) -> tuple[float, ...]:
        """N and N m of one count."""
        return (1.0 / self.counts_per_force,) * 3 + (1.0 / self.counts_per_torque,) * 3


class AtiNetFt(RdtSensor):
    """The driver."""

    def __init__(self, settings: AtiNetFtSettings) -> None:
        commands = ((SET_BIAS, 0),) if settings.sets_bias else ()
        super().__init__(settings, commands, np.array(settings.scales), settings.sample_hz)


ATI_NET_FT_MODEL = DeviceModel(
    name="ati_net_ft",
    kind=DeviceKind.FORCE_TORQUE,
    description="ATI force-torque sensor with a Net Box, over UDP (RDT)",
    settings=AtiNetFtSettings,
    implementation="grasp_factory.capture.devices.ati_net_ft:AtiNetFt",
    simulator="grasp_factory.capture.simulators.rdt:SimulatedAtiNetFt",
)
