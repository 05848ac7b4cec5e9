"""The inertial measurement unit at the wrist."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, Pose, inverse, quat_xyzw_to_matrix
from grasp_factory.core.linear import product, turned, turned_back
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class WristImu(Sensor):
    """Specific force and angular velocity at the origin of the wrist sensor's frame.

    The specific force is the change of velocity since the previous sample, divided by that time,
    minus gravity. An integrating accelerometer measures the same; it is exact for any motion.
    """

    def __init__(self, scene: Scene) -> None:
        self._world, self._robot = scene.world, scene.robot
        self._gravity = np.array([0.0, 0.0, -scene.spec.physics.gravity])
        self._timestamps: list[float] = []
        self._motions = array("d")
        self._read()

    def sample(self, tick: Tick) -> None:
        """Store time and motion."""
        self._timestamps.append(tick.timestamp)
        self._read()

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return timestamp (n,), specific force and angular velocity (n, 3), and the IMU's pose."""
        times = np.array([0.0, *self._timestamps])
        motions = np.array(self._motions).reshape(-1, 13)
        R, angular = quat_xyzw_to_matrix(motions[:, 3:7]), motions[:, 10:]
        velocity = self._origin_velocities(R, motions[:, 7:10], angular)
        acceleration = np.diff(velocity, axis=0) / np.diff(times)[:, None]
        force = turned_back(R[1:], acceleration - self._gravity)
        return {
            "timestamp": times[1:],
            "specific_force": force.astype(np.float32),
            "angular_velocity": turned_back(R[1:], angular[1:]).astype(np.float32),
            "T_tcp_imu": self._T_tcp_imu(),
        }

    def _read(self) -> None:
        """Store position, quat_xyzw, linear and angular velocity, 13 numbers."""
        position, quat, linear, angular = self._world.link_motion(
            self._robot.body, self._robot.first_tool_link
        )
        self._motions.extend((*position, *quat, *linear, *angular))

    def _origin_velocities(self, R: Array, linear: Array, angular: Array) -> Array:
        """Return the velocity of the frame's origin: Bullet reports that of the COM."""
        com = self._world.inertial_frame(self._robot.body, self._robot.first_tool_link).position
        return np.asarray(linear + np.cross(angular, -turned(R, np.array(com))))

    def _T_tcp_imu(self) -> Array:
        """Return the sensor's pose in the TCP frame (4, 4); both are fixed to the hand."""
        frame = self._world.link_frames(self._robot.body, [self._robot.first_tool_link])[0]
        return product(inverse(self._robot.T_world_tcp()), Pose(*frame).matrix())
