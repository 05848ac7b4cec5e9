"""Where the open gripper is: its boxes against points, its lowest corner against the table."""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.gripper import Gripper
from grasp_factory.policies.base import TIP_CLEARANCE

PALM_BREADTH = 0.064
"""Metres along x: the hand of either robot of the table is at most as broad (Panda 63 mm)."""
PALM_LENGTH = 0.204
"""Metres along y: as above (Panda 204 mm)."""
PALM_DEPTH = 0.100
"""Metres behind the palm that are checked: the straight part of the approach sweeps this far."""

Box = tuple[Array, Array]
"""Lower and upper corner (3,), TCP frame, metres."""


def open_gripper(gripper: Gripper, width: float) -> tuple[Box, ...]:
    """Return the boxes of both fingers and of the palm for a width between the pads."""
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
    """Return whether any point (N, 3), TCP frame, is in a box or closer to it than ``margin``."""
    return any(
        bool(((points > low - margin) & (points < high + margin)).all(axis=1).any())
        for low, high in boxes
    )


def off_the_table(T_world_tcp: Array, gripper: Gripper, width: float) -> float:
    """Return the metres by which the open fingers must rise to keep the tips' clearance."""
    along = T_world_tcp[2, :3]
    drops = [
        float(np.minimum(along * low, along * high).sum())
        for low, high in open_gripper(gripper, width)
    ]
    return max(0.0, TIP_CLEARANCE - float(T_world_tcp[2, 3]) - min(drops))
