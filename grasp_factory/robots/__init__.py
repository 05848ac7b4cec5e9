"""Describe robots as pure data, with kinematics and trajectories; no PyBullet.

A new robot is one file and one row in ``ROBOTS``.
"""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.robots.base import RobotModel, arm_chain
from grasp_factory.robots.kuka_iiwa import KUKA_IIWA
from grasp_factory.robots.panda import PANDA

ROBOTS: Mapping[str, RobotModel] = {model.name: model for model in (KUKA_IIWA, PANDA)}

__all__ = ["ROBOTS", "RobotModel", "arm_chain"]
