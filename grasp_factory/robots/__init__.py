"""Robots: one file of data each. A new one is one file and one row in the table below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.robots.base import RobotModel, arm_chain
from grasp_factory.robots.kuka_iiwa import KUKA_IIWA
from grasp_factory.robots.panda import PANDA

ROBOTS: Mapping[str, RobotModel] = {model.name: model for model in (KUKA_IIWA, PANDA)}

__all__ = ["ROBOTS", "RobotModel", "arm_chain"]
