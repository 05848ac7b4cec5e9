"""Time and phase of each record."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.sensors.base import Sensor, Tick


class Clock(Sensor):
    """Timestamps in simulation time, and the phase they belong to."""

    def __init__(self) -> None:
        self._timestamps: list[float] = []
        self._phases: list[int] = []

    def sample(self, tick: Tick) -> None:
        """Note time and phase."""
        self._timestamps.append(tick.timestamp)
        self._phases.append(int(tick.phase))

    def streams(self) -> dict[str, NDArray[Any]]:
        """Return ``timestamp`` (s) and ``phase``."""
        return {
            "timestamp": np.array(self._timestamps, np.float64),
            "phase": np.array(self._phases, np.uint8),
        }
