"""The wrist's force-torque sensor."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import quat_xyzw_to_matrix
from grasp_factory.core.linear import turned
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class WristForceTorque(Sensor):
    """The load of the tool on the flange sensor, weight and inertia included.

    A tool of mass m at rest reads a force of m g along gravity; a held object adds its weight.
    Bullet reports the opposite wrench, that of the parent on the child, about the child's centre of
    mass and in its inertial axes. Here it is about the sensor's origin and in the sensor's axes.
    """

    def __init__(self, scene: Scene) -> None:
        self._world, self._robot = scene.world, scene.robot
        self._rows = array("d")

    def sample(self, tick: Tick) -> None:
        """Store the joint's reaction."""
        self._rows.extend(tick.joints[-1][2])

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return ``wrist_wrench`` (samples, 6): force N, torque N m."""
        reaction = np.array(self._rows, np.float64).reshape(-1, 6)
        com = self._world.inertial_frame(self._robot.body, self._robot.first_tool_link)
        R = quat_xyzw_to_matrix(com.quat_xyzw)
        force = -turned(R, reaction[:, :3])
        torque = -turned(R, reaction[:, 3:]) + np.cross(np.array(com.position), force)
        return {"wrist_wrench": np.hstack([force, torque]).astype(np.float32)}
