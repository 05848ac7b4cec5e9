"""A world for playback: bodies have the poses of a recording, and time does not advance."""

from __future__ import annotations

from typing import NoReturn

from grasp_factory.core.geometry import Pose
from grasp_factory.errors import GraspFactoryError
from grasp_factory.simulation.world.client import World
from grasp_factory.simulation.world.engine import p


class PosedWorld(World):
    """A world without physics, in which bodies and joints may be placed at any time."""

    def __enter__(self) -> PosedWorld:
        return self

    def seal(self) -> None:
        """Do nothing: here bodies may be placed at any time."""

    def step(self) -> NoReturn:
        """Refuse: the recording was simulated before.

        Raises:
            GraspFactoryError: always.
        """
        raise GraspFactoryError("cannot step: in a posed world nothing moves by physics")

    def place_body(self, body: int, pose: Pose) -> None:
        """Place a body so that its own (URDF) frame is at a pose in the world."""
        placed = Pose.from_matrix(pose.matrix() @ self.inertial_frame(body).matrix())
        p.resetBasePositionAndOrientation(
            body, placed.position, placed.quat_xyzw, physicsClientId=self._client
        )
