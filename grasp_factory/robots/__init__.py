"""Describe robots as pure data, with kinematics and trajectories; no PyBullet.

A new robot is one file and one row in ``ROBOTS``.
"""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.core.gripper import Gripper
from grasp_factory.errors import lookup
from grasp_factory.robots.base import RobotModel, arm_chain
from grasp_factory.robots.kuka_iiwa import KUKA_IIWA
from grasp_factory.robots.panda import PANDA

ROBOTS: Mapping[str, RobotModel] = {model.name: model for model in (KUKA_IIWA, PANDA)}


def gripper_of(robot: str) -> Gripper:
    """Return the gripper of a robot of the table.

    Raises:
        UnknownNameError: naming all valid names. A robot of a user's file is known only to a
            process that was given this file.
    """
    return lookup(ROBOTS, "robot", robot).gripper


__all__ = ["ROBOTS", "RobotModel", "arm_chain", "gripper_of"]
