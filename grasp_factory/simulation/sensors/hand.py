"""The force on the target from all links except the pads: palm, finger sides, arm."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class HandContact(Sensor):
    """The force on the target from all links except the pads; if zero, only the pads hold it."""

    def __init__(self, scene: Scene) -> None:
        self._robot, self._target = scene.robot, scene.objects[0]
        self._forces: list[list[float]] = []

    def sample(self, tick: Tick) -> None:
        """Sum the contacts of the last step."""
        total = [0.0, 0.0, 0.0]
        for c in tick.contacts:
            if (c[1], c[2]) == (self._target, self._robot.body) and c[4] not in self._robot.pads:
                sign = 1.0
            elif (c[2], c[1]) == (self._target, self._robot.body) and c[3] not in self._robot.pads:
                sign = -1.0
            else:
                continue
            for i in range(3):
                total[i] += sign * (c[9] * c[7][i] + c[10] * c[11][i] + c[12] * c[13][i])
        self._forces.append(total)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return ``hand_force`` (samples, 3), world, N."""
        return {"hand_force": np.array(self._forces, np.float32).reshape(-1, 3)}
