"""Time, phase and shake level of each record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class Clock(Sensor):
    """The time of each record in simulation time, with its phase and shake level."""

    def __init__(self, scene: Scene) -> None:
        self._timestamps: list[float] = []
        self._phases: list[int] = []
        self._levels: list[float] = []

    def sample(self, tick: Tick) -> None:
        """Store time, phase and level."""
        self._timestamps.append(tick.timestamp)
        self._phases.append(int(tick.phase))
        self._levels.append(tick.shake_level)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return ``timestamp`` (s), ``phase`` and ``shake_level``."""
        return {
            "timestamp": np.array(self._timestamps, np.float64),
            "phase": np.array(self._phases, np.uint8),
            "shake_level": np.array(self._levels, np.float64),
        }
