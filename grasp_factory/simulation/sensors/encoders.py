"""Joint and gripper encoders, motor torques and commands, and the pose of the TCP."""

from __future__ import annotations

from array import array
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.core.linear import turned
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class Encoders(Sensor):
    """The signals that the robot's own controller has."""

    def __init__(self, scene: Scene) -> None:
        self._robot = scene.robot
        self._joints, self._hand, self._targets = array("d"), array("d"), array("d")

    def sample(self, tick: Tick) -> None:
        """Store the joints' states and the hand's frame."""
        positions, velocities, _, torques = zip(*tick.joints[:-1], strict=True)
        self._joints.extend((*positions, *velocities, *torques))
        position, quat = tick.frames[0]
        self._hand.extend((*position, *quat))
        self._targets.extend((*tick.joint_position_targets, tick.gripper_width_target))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the joint, gripper and TCP series."""
        n = len(self._robot.arm)
        joints = np.array(self._joints, np.float32).reshape(-1, 3, n + 2)
        targets = np.array(self._targets, np.float32).reshape(-1, n + 1)
        return {
            "joint_positions": joints[:, 0, :n],
            "joint_velocities": joints[:, 1, :n],
            "joint_torques": joints[:, 2, :n],
            "joint_position_targets": targets[:, :n],
            "gripper_width": joints[:, 0, n:].sum(axis=1),
            "gripper_width_target": targets[:, n],
            # The motors push towards smaller joint values to close.
            "gripper_force": -joints[:, 2, n:].mean(axis=1),
            "tcp_pose": self._tcp_poses().astype(np.float32),
        }

    def _tcp_poses(self) -> Array:
        """Return the TCP's poses (samples, 7); its axes are parallel to the hand's."""
        poses = np.array(self._hand, np.float64).reshape(-1, 7)
        poses[:, :3] += turned(quat_xyzw_to_matrix(poses[:, 3:]), self._robot.T_hand_tcp[:3, 3])
        return poses
