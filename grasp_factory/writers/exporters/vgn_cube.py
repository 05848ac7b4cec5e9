"""The cube of voxels in which VGN looks for grasps, and the frame of its grasps.

The cube's edges are parallel to the world's axes, and the table lies ``finger_depth`` above its
lower side: https://github.com/ethz-asl/vgn, src/vgn/simulation.py. VGN's grasp frame has our axes,
but its origin is between the roots of the fingers, ``finger_depth`` behind their ends: draw_grasp
of src/vgn/vis.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.geometry import Array, quat_xyzw_to_matrix
from grasp_factory.core.serialization import check_range
from grasp_factory.robots import gripper_of

RESOLUTION = 40
"""Voxels along an edge of VGN's grids."""
FINGERS_IN_CUBE = 6.0
"""The cube's edge divided by finger_depth: VGN, scripts/construct_dataset.py."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VgnSettings:
    """Settings of the format."""

    cameras: tuple[str, ...] = ()
    """Cameras whose depth is used; empty for all that do not move, or for all if all move."""
    size: float = 0.3
    """Edge of the cube, metres; six times what VGN takes as the length of the fingers."""

    def __post_init__(self) -> None:
        check_range(self, "size", 0.1, 10.0, "m")

    @property
    def finger_depth(self) -> float:
        """Length of VGN's fingers, metres."""
        return self.size / FINGERS_IN_CUBE

    @property
    def voxel(self) -> float:
        """Edge of a voxel, metres."""
        return self.size / RESOLUTION


def cube_origin(config: FactoryConfig, settings: VgnSettings) -> Array:
    """Return the cube's corner in the world frame, (3,) metres: it is about the workspace."""
    lower, upper = config.workspace.lower, config.workspace.upper
    x, y = ((lower[i] + upper[i] - settings.size) / 2.0 for i in (0, 1))
    return np.array([x, y, -settings.finger_depth])


def finger_root(
    position: Array, quat_xyzw: Array, config: FactoryConfig, settings: VgnSettings
) -> Array:
    """Return the origins (..., 3) of VGN's grasp frame in the cube, metres, of grasps of the TCP.

    Args:
        position: of the TCP in the world frame, (..., 3) metres.
        quat_xyzw: its orientation, (..., 4).
        config: of the store.
        settings: of the cube.
    """
    tip_distance = gripper_of(config.robot).tip_distance
    approach = quat_xyzw_to_matrix(quat_xyzw)[..., :, 2]
    ahead = tip_distance - settings.finger_depth
    return np.asarray(position + ahead * approach - cube_origin(config, settings))
