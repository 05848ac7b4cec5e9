"""One DIRECT client of PyBullet behind a small typed interface.

All known pitfalls of the engine are handled here: settings that survive a reset, contact rows that
are not ordered by id, link states that are one step late, frames at the centre of mass.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Camera, Light
from grasp_factory.core.config.physics import PhysicsConfig, Stepping
from grasp_factory.core.geometry import IDENTITY, Pose
from grasp_factory.core.renderer import Renderer
from grasp_factory.errors import GraspFactoryError
from grasp_factory.objects import Compound
from grasp_factory.simulation.world.bodies import create_compound
from grasp_factory.simulation.world.boxes import box
from grasp_factory.simulation.world.connection import connect, disconnect
from grasp_factory.simulation.world.engine import muted, p
from grasp_factory.simulation.world.loading import load_urdf
from grasp_factory.simulation.world.names import MeshNames
from grasp_factory.simulation.world.textures import Textures
from grasp_factory.simulation.world.visuals import Hidden, Visuals

CONTACT_BREAKING_THRESHOLD = 0.02  # Bullet's default; survives resets, so each reset sets it

EngineRow = tuple[Any, ...]


class World:
    """One physics client. An episode starts with ``reset`` and builds everything again.

    Raises:
        UsageError: if the renderer cannot be loaded on this machine.
        GraspFactoryError: if a world of this process has OpenGL already.
    """

    def __init__(self, renderer: Renderer = Renderer.TINY) -> None:
        self.renderer = renderer
        self._client = connect(renderer)
        self._sealed = False
        self._textures = Textures(self._client)
        self._visuals = Visuals(self._client, renderer, self._textures)
        self._names = MeshNames(renderer)

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect the client."""
        disconnect(self._client)

    # -- building -------------------------------------------------------------------------

    def reset(self, physics: PhysicsConfig) -> None:
        """Empty the world and set every setting, including those that survive a reset."""
        p.resetSimulation(physicsClientId=self._client)
        self._sealed = False
        self._textures.forget()
        self._visuals.forget()
        self._names.forget()
        p.setPhysicsEngineParameter(
            numSubSteps=0,  # substeps would divide contact forces and multiply motor forces
            contactBreakingThreshold=CONTACT_BREAKING_THRESHOLD,
            deterministicOverlappingPairs=0,
            physicsClientId=self._client,
        )
        p.setGravity(0.0, 0.0, -physics.gravity, physicsClientId=self._client)
        self.set_stepping(physics.free)

    def set_stepping(self, stepping: Stepping) -> None:
        """Set time step and solver iterations; they may change during an episode."""
        p.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / stepping.hz,
            numSolverIterations=stepping.iterations,
            numNonContactInnerIterations=stepping.motor_iterations,
            solverResidualThreshold=stepping.residual,
            physicsClientId=self._client,
        )

    def load_urdf(
        self, path: Path, pose: Pose, *, fixed: bool, file_inertia: bool = False, scale: float = 1.0
    ) -> int:
        """Load a URDF with its own frame at ``pose`` and return the body.

        ``package://pybullet_data/`` in the file means that package's folder.

        Raises:
            RecipeError: if the file cannot be loaded.
        """
        self._refuse_when_sealed("load a body")
        name, client = self._names.of(path), self._client
        body = load_urdf(client, name, pose, fixed=fixed, file_inertia=file_inertia, scale=scale)
        self._undamp(body)
        return body

    def add_compound(
        self,
        body: Compound,
        pose: Pose,
        *,
        mass: float,
        scale: float = 1.0,
        rgba: Sequence[float] = (0.6, 0.6, 0.6, 1.0),
    ) -> int:
        """Create a body from parts with its own frame at ``pose`` and return it.

        Raises:
            RecipeError: if it has too many parts, or a mesh file cannot be loaded.
        """
        self._refuse_when_sealed("add a body")
        named = self._names.within(body)
        with muted(1):
            created = create_compound(self._client, named, pose, mass=mass, scale=scale, rgba=rgba)
        self._undamp(created)
        return created

    def add_box(
        self,
        half_extents: Sequence[float],
        position: Sequence[float],
        rgba: Sequence[float],
        *,
        mass: float = 0.0,
    ) -> int:
        """Create a box (static when ``mass`` is 0) and return the body."""
        x, y, z = position
        pose = Pose((x, y, z), IDENTITY.quat_xyzw)
        return self.add_compound(box(half_extents), pose, mass=mass, rgba=rgba)

    # -- appearance -----------------------------------------------------------------------

    def set_look(self, body: int, color: Sequence[float], texture: str = "") -> None:
        """Set a body's colour (RGB, 0 to 1), multiplied by a texture's colour if one is named.

        Raises:
            UnknownNameError: if there is no such texture.
            RecipeError: if the renderer does not support textures.
        """
        self._visuals.set_look(body, color, texture)

    def hide(self, body: int, links: Container[int] | None = None) -> Hidden:
        """Hide a body, or some of its links, in all renders; its physics do not change."""
        return self._visuals.hide(body, links)

    def show(self, body: int, hidden: Hidden) -> None:
        """Show a body again as it was."""
        self._visuals.show(body, hidden)

    def change_dynamics(self, body: int, link: int, **settings: Any) -> None:
        """Set dynamics by PyBullet's own names (``mass``, ``lateralFriction``, ...)."""
        p.changeDynamics(body, link, **settings, physicsClientId=self._client)

    def place_joints(self, body: int, joints: Sequence[int], positions: Sequence[float]) -> None:
        """Set joint positions without motion; only while the scene is being built."""
        self._refuse_when_sealed("place joints")
        for joint, position in zip(joints, positions, strict=True):
            p.resetJointState(body, joint, position, 0.0, physicsClientId=self._client)

    def gear(self, body: int, parent: int, joints: tuple[int, int], max_force: float) -> None:
        """Couple two mirrored prismatic joints of a body, so that they move together."""
        links = [p.getJointInfo(body, j, physicsClientId=self._client) for j in joints]
        constraint = p.createConstraint(
            body, joints[0], body, joints[1], p.JOINT_GEAR, links[0][13],
            [0, 0, 0], [0, 0, 0], physicsClientId=self._client,
        )  # fmt: skip
        p.changeConstraint(
            constraint, gearRatio=-1, erp=0.3, maxForce=max_force, physicsClientId=self._client
        )

    def sense_wrench(self, body: int, joint: int, on: bool) -> None:
        """Switch on or off the sensor of the wrench that a fixed joint transmits."""
        p.enableJointForceTorqueSensor(body, joint, on, physicsClientId=self._client)

    def seal(self) -> None:
        """End the construction: from now on bodies move by physics alone until ``reset``."""
        self._sealed = True

    # -- names ----------------------------------------------------------------------------

    def joints(self, body: int) -> dict[str, int]:
        """Return joint indices by name; a joint's index is also its child link's."""
        return {self._info(body, j)[1].decode(): j for j in self._joint_range(body)}

    def links(self, body: int) -> dict[str, int]:
        """Return link indices by name, without the base."""
        return {self._info(body, j)[12].decode(): j for j in self._joint_range(body)}

    # -- acting ---------------------------------------------------------------------------

    def command_positions(
        self,
        body: int,
        joints: Sequence[int],
        positions: Sequence[float],
        velocities: Sequence[float],
        *,
        forces: Sequence[float],
        gain: float,
    ) -> None:
        """Set position targets (rad or m), feed-forward velocities and force limits."""
        p.setJointMotorControlArray(
            body, joints, p.POSITION_CONTROL, targetPositions=positions,
            targetVelocities=velocities, forces=forces, positionGains=[gain] * len(joints),
            velocityGains=[1.0] * len(joints), physicsClientId=self._client,
        )  # fmt: skip

    def command_velocities(
        self, body: int, joints: Sequence[int], velocities: Sequence[float], forces: Sequence[float]
    ) -> None:
        """Set velocity targets with force limits."""
        p.setJointMotorControlArray(
            body, joints, p.VELOCITY_CONTROL, targetVelocities=velocities, forces=forces,
            physicsClientId=self._client,
        )  # fmt: skip

    def step(self) -> None:
        """Advance by one time step."""
        p.stepSimulation(physicsClientId=self._client)

    # -- reading state and images ----------------------------------------------------------

    def joint_states(self, body: int, joints: Sequence[int]) -> tuple[EngineRow, ...]:
        """Return (position, velocity, reaction (6,), motor torque) for each joint."""
        return tuple(p.getJointStates(body, joints, physicsClientId=self._client))

    def link_frames(self, body: int, links: Sequence[int]) -> list[EngineRow]:
        """Return (position, quat_xyzw) of each link's URDF frame, world, up to date."""
        states = p.getLinkStates(
            body, links, computeForwardKinematics=1, physicsClientId=self._client
        )
        return [state[4:6] for state in states]

    def link_motion(self, body: int, link: int) -> EngineRow:
        """Return (position, quat_xyzw) of a link's frame, (linear, angular) speed of its COM."""
        return tuple(p.getLinkState(body, link, 1, 1, physicsClientId=self._client)[4:8])

    def com_frame(self, body: int) -> EngineRow:
        """Return (position, quat_xyzw) of a body's inertial frame, which is centred on its COM."""
        return tuple(p.getBasePositionAndOrientation(body, physicsClientId=self._client))

    def bounds(self, body: int) -> tuple[Sequence[float], Sequence[float]]:
        """Return the corners (lower, upper) of the box around a body's base, world, metres."""
        lower, upper = p.getAABB(body, -1, physicsClientId=self._client)
        return lower, upper

    def inertial_frame(self, body: int, link: int = -1) -> Pose:
        """Return the pose of a link's inertial frame in its URDF frame."""
        info = p.getDynamicsInfo(body, link, physicsClientId=self._client)
        return Pose(tuple(info[3]), tuple(info[4]))

    def mass(self, body: int, link: int = -1) -> float:
        """Return a link's mass in kg."""
        return float(p.getDynamicsInfo(body, link, physicsClientId=self._client)[0])

    def contacts(self) -> tuple[EngineRow, ...]:
        """Return PyBullet's rows for all contacts; filtered queries flip signs or omit rows.

        In a row, [1] and [2] are bodies A and B, [3] and [4] their links, [5] and [6] the points
        on A and B, [7] the normal on B pointing to A, [8] the distance, [9] the normal force,
        [10] and [12] the friction forces along [11] and [13]; forces act on A.
        """
        return tuple(p.getContactPoints(physicsClientId=self._client))

    def render(
        self, camera: Camera, light: Light
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
        """Return RGB (H, W, 3), the z-buffer (H, W) and body + (link + 1) * 2^24 (H, W)."""
        return self._visuals.render(camera, light)

    def _undamp(self, body: int) -> None:
        """Remove the damping that Bullet sets for every link (0.04): there is no air resistance."""
        for link in (-1, *self._joint_range(body)):
            self.change_dynamics(body, link, linearDamping=0.0, angularDamping=0.0)

    def _info(self, body: int, joint: int) -> EngineRow:
        return tuple(p.getJointInfo(body, joint, physicsClientId=self._client))

    def _joint_range(self, body: int) -> range:
        return range(p.getNumJoints(body, physicsClientId=self._client))

    def _refuse_when_sealed(self, what: str) -> None:
        if self._sealed:
            raise GraspFactoryError(f"cannot {what}: the scene is built, only physics moves it now")
