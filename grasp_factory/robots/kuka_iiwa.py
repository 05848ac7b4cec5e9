"""KUKA LBR iiwa 14 R820 with a parallel gripper like the WSG 50-110.

The header of the URDF file has the sources of its numbers.
"""

from __future__ import annotations

import math

from grasp_factory.core.gripper import Gripper
from grasp_factory.robots.base import RobotModel

# Datasheet "LBR iiwa 7 R800, LBR iiwa 14 R820": axis speeds and torques, A1 to A7.
_AXIS_SPEEDS_DEG = (85.0, 85.0, 100.0, 75.0, 130.0, 135.0, 135.0)
_AXIS_TORQUES = (320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0)

KUKA_IIWA = RobotModel(
    name="kuka_iiwa",
    description="KUKA LBR iiwa 14 R820, WSG 50-110 class gripper (110 mm, 5 to 80 N)",
    urdf="assets/iiwa14_wsg50.urdf",
    file_inertia=True,
    base_link="link_0",
    tcp_link="tcp",
    arm_joints=tuple(f"joint_{i}" for i in range(1, 8)),
    finger_joints=("left_finger_joint", "right_finger_joint"),
    pad_links=("left_pad", "right_pad"),
    pad_center=(0.0, 0.0, 0.0),
    ft_joint="ft_joint",
    first_tool_link="ft_sensor",
    # Sums over the URDF's tool links; the conformance test compares them with the loaded body.
    tool_mass=1.26,
    tool_com=(0.0, 0.0, 0.0726349),
    # TCP at (0.32, 0, 0.52), pointing down: behind and above the workspace.
    home=(0.0, -0.1885, 0.0, -1.6781, 0.0, 1.652, 0.0),
    joint_velocity_limits=tuple(math.radians(v) for v in _AXIS_SPEEDS_DEG),
    joint_torque_limits=_AXIS_TORQUES,
    gripper=Gripper(
        max_width=0.110,  # WSG 50-110 datasheet: stroke 110 mm
        tip_distance=0.024,
        palm_distance=0.056,
        pad_size=(0.0204, 0.0476),
        finger_thickness=0.016,
        force_range=(5.0, 80.0),  # WSG 50-110 datasheet
        max_finger_speed=0.42,  # WSG 50-110 datasheet
    ),
)
