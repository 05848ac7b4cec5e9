"""Franka Emika Panda with the Franka Hand, from pybullet_data's URDF."""

from __future__ import annotations

import math

from grasp_factory.core.gripper import Gripper
from grasp_factory.robots.base import RobotModel

PANDA = RobotModel(
    name="panda",
    description="Franka Emika Panda with the Franka Hand (80 mm, up to 70 N)",
    urdf="franka_panda/panda.urdf",
    # The file has 0.1 kg m2 for every link, even for a finger; values from the shapes are better.
    file_inertia=False,
    base_link="panda_link0",
    tcp_link="panda_grasptarget",
    arm_joints=tuple(f"panda_joint{i}" for i in range(1, 8)),
    finger_joints=("panda_finger_joint1", "panda_finger_joint2"),
    pad_links=("panda_leftfinger", "panda_rightfinger"),
    pad_center=(0.0, 0.0, 0.0466),  # at the height of panda_grasptarget
    ft_joint="panda_hand_joint",
    first_tool_link="panda_hand",
    tool_mass=1.01,
    tool_com=(0.0, 0.0, 0.04760397),
    # The "ready" posture of Franka's own examples, with the TCP at (0.31, 0, 0.49), pointing down.
    home=(0.0, -math.pi / 4, 0.0, -3 * math.pi / 4, 0.0, math.pi / 2, math.pi / 4),
    # Franka Control Interface documentation, limits for Panda: rad/s and N m.
    joint_velocity_limits=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    joint_torque_limits=(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    gripper=Gripper(
        max_width=0.080,  # Franka Hand product manual
        tip_distance=0.0115,
        palm_distance=0.0355,
        pad_size=(0.0175, 0.0185),
        finger_thickness=0.015,
        force_range=(1.0, 70.0),  # continuous force 70 N, same manual
        max_finger_speed=0.05,  # same manual: 50 mm/s per finger
    ),
)
