"""The description of a robot as data, which the driver, planners and readers use."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.core.gripper import Gripper
from grasp_factory.core.package_files import folder_of
from grasp_factory.robots.kinematics import Chain


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotModel:
    """A robot arm with a parallel gripper: one articulated body whose base is at the origin.

    The axes of all tool frames are parallel: +z approaches, +y closes, the left finger is at +y.
    """

    name: str
    description: str
    urdf: str
    """Path of the URDF file: ``assets/...`` in ``robots``, or a path inside ``pybullet_data``."""
    file_inertia: bool
    """Whether to use the URDF's inertias; otherwise they are computed from the shapes."""
    base_link: str
    tcp_link: str
    arm_joints: tuple[str, ...]
    finger_joints: tuple[str, str]
    """Left, right: prismatic joints, 0 when closed; each moves half of the gripper width."""
    pad_links: tuple[str, str]
    """Left, right: the links whose contacts the tactile sensors measure."""
    pad_center: tuple[float, float, float]
    """Centre of the left pad's face in its link's frame, metres; for the right pad y is negated."""
    ft_joint: str
    """The fixed joint at which the wrist's force-torque sensor measures."""
    first_tool_link: str
    """Child link of ``ft_joint``; it and all links after it are the tool, labelled as gripper."""
    tool_mass: float
    """Mass of the links after the force-torque sensor, kg."""
    tool_com: tuple[float, float, float]
    """Centre of mass of the tool in the sensor's frame, metres."""
    home: tuple[float, ...]
    """Joint positions, rad, at which the arm does not hide the workspace from the cameras."""
    joint_velocity_limits: tuple[float, ...]
    """rad/s, datasheet."""
    joint_torque_limits: tuple[float, ...]
    """N m, datasheet."""
    gripper: Gripper
    pad_friction: float = 1.0
    """Lateral friction coefficient of the pads.

    A contact has the product of both bodies' coefficients, so with 1 it has the object's.
    """

    def path(self) -> Path:
        """Return the URDF file.

        Raises:
            MissingLibraryError: if the file is part of PyBullet's data, which is not installed.
        """
        if self.urdf.startswith("assets/"):
            return folder_of("grasp_factory") / "robots" / self.urdf
        return folder_of("pybullet_data") / self.urdf

    def facts(self) -> dict[str, Any]:
        """Return the facts that a user of the dataset needs, as plain values for the store."""
        return {
            "name": self.name,
            "description": self.description,
            "joint_names": list(self.arm_joints),
            "home": list(self.home),
            "tool_mass": self.tool_mass,
            "tool_com": list(self.tool_com),
            "pad_size": list(self.gripper.pad_size),
            "max_width": self.gripper.max_width,
        }


@cache
def arm_chain(model: RobotModel) -> Chain:
    """Return the kinematic chain from base to TCP, with the datasheet's velocity limits."""
    chain = Chain.from_urdf(model.path(), model.base_link, model.tcp_link)
    limits = np.array(model.joint_velocity_limits)
    return Chain(chain.joint_names, chain.lower, chain.upper, limits,
                 chain.T_previous_joint, chain.T_joint_tip)  # fmt: skip
