"""Joint and gripper encoders, motor torques and what was commanded; the TCP pose that follows."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.robots import Robot
from grasp_factory.sensors.base import Sensor, Tick
from grasp_factory.world import World


class Encoders(Sensor):
    """Everything that the robot's own controller knows."""

    def __init__(self, world: World, robot: Robot) -> None:
        self._world, self._robot = world, robot
        self._joints: list[Any] = []
        self._tcp: list[Any] = []
        self._targets: list[Any] = []

    def sample(self, tick: Tick) -> None:
        """Read the joints and the TCP's frame."""
        robot = self._robot
        states = self._world.joint_states(robot.body, [*robot.arm, *robot.fingers])
        self._joints.append([(state[0], state[1], state[3]) for state in states])
        position, quat = self._world.link_frames(robot.body, [robot.tcp])[0]
        self._tcp.append((*position, *quat))
        self._targets.append((*tick.joint_position_targets, tick.gripper_width_target))

    def streams(self) -> dict[str, NDArray[Any]]:
        """Return the joint, gripper and TCP streams."""
        n = len(self._robot.arm)
        joints = np.array(self._joints, np.float32).reshape(-1, n + 2, 3)
        targets = np.array(self._targets, np.float32).reshape(-1, n + 1)
        return {
            "joint_positions": joints[:, :n, 0],
            "joint_velocities": joints[:, :n, 1],
            "joint_torques": joints[:, :n, 2],
            "joint_position_targets": targets[:, :n],
            "gripper_width": joints[:, n:, 0].sum(axis=1),
            "gripper_width_target": targets[:, n],
            # The motors push towards smaller joint values to close.
            "gripper_force": -joints[:, n:, 2].mean(axis=1),
            "tcp_pose": np.array(self._tcp, np.float32).reshape(-1, 7),
        }
