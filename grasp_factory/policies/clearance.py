"""Collision checks of the open gripper, as boxes, with points and with the table."""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies.base import TIP_CLEARANCE

PALM_BREADTH = 0.064
"""Size of the palm along x, metres: an upper bound for the robots in ``ROBOTS`` (Panda 63 mm)."""
PALM_LENGTH = 0.204
"""Size of the palm along y, metres: an upper bound as above (Panda 204 mm)."""
PALM_DEPTH = 0.100
"""Metres behind the palm that are checked: the palm moves this far on the straight approach."""

Box = tuple[Array, Array]
"""Lower and upper corner (3,), TCP frame, metres."""


def open_gripper(gripper: Gripper, width: float) -> tuple[Box, ...]:
    """Return the boxes of both fingers and of the palm for a width (metres) between the pads."""
    half_pad, inner = gripper.pad_size[0] / 2.0, width / 2.0
    outer = inner + gripper.finger_thickness
    palm, tip = -gripper.palm_distance, gripper.tip_distance
    return (
        (np.array([-half_pad, inner, palm]), np.array([half_pad, outer, tip])),
        (np.array([-half_pad, -outer, palm]), np.array([half_pad, -inner, tip])),
        (
            np.array([-PALM_BREADTH / 2.0, -PALM_LENGTH / 2.0, palm - PALM_DEPTH]),
            np.array([PALM_BREADTH / 2.0, PALM_LENGTH / 2.0, palm]),
        ),
    )


def is_hit(boxes: tuple[Box, ...], points: Array, margin: float) -> bool:
    """Return whether a point (N, 3), TCP frame, is in a box enlarged by ``margin`` metres."""
    return any(
        bool(((points > low - margin) & (points < high + margin)).all(axis=1).any())
        for low, high in boxes
    )


def off_the_table(T_world_tcp: Array, gripper: Gripper, width: float) -> float:
    """Return by how many metres (>= 0) to raise the open fingers to keep ``TIP_CLEARANCE``."""
    along = T_world_tcp[2, :3]
    drops = [
        float(np.minimum(along * low, along * high).sum())
        for low, high in open_gripper(gripper, width)
    ]
    return max(0.0, TIP_CLEARANCE - float(T_world_tcp[2, 3]) - min(drops))
