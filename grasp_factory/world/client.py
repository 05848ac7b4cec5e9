"""One DIRECT client of PyBullet behind a small typed face.

What is known to trap people is settled here, once: settings that survive a reset, contact rows
whose order is not by id, link states that lag a step, frames at the centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.camera import Camera, Light
from grasp_factory.errors import GraspFactoryError, RecipeError
from grasp_factory.geometry import Pose
from grasp_factory.objects import Compound
from grasp_factory.sections import PhysicsConfig
from grasp_factory.world.bodies import create_box, create_compound
from grasp_factory.world.engine import muted, p
from grasp_factory.world.textures import Textures
from grasp_factory.world.urdf import with_packages
from grasp_factory.world.visuals import Hidden, hide, render, set_look, show

CONTACT_BREAKING_THRESHOLD = 0.02  # Bullet's default; survives resets, so it is set at each one

Row = tuple[Any, ...]


class World:
    """One physics client. An episode starts with ``reset`` and builds everything again."""

    def __init__(self) -> None:
        if not p.isNumpyEnabled():
            raise GraspFactoryError(
                "this pybullet was built without numpy: install the wheel, pybullet==3.2.7"
            )
        self._client: int = p.connect(p.DIRECT)
        self._sealed = False
        self._textures = Textures(self._client)

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect the client."""
        p.disconnect(physicsClientId=self._client)

    # -- building -------------------------------------------------------------------------

    def reset(self, physics: PhysicsConfig) -> None:
        """Empty the world and set every setting, those that survive a reset above all."""
        p.resetSimulation(physicsClientId=self._client)
        self._sealed = False
        self._textures.forget()
        p.setPhysicsEngineParameter(
            fixedTimeStep=1.0 / physics.free_hz,
            numSubSteps=0,  # with substeps, contact forces come out divided and motors multiplied
            numSolverIterations=physics.solver_iterations,
            contactBreakingThreshold=CONTACT_BREAKING_THRESHOLD,
            deterministicOverlappingPairs=0,
            physicsClientId=self._client,
        )
        p.setGravity(0.0, 0.0, -physics.gravity, physicsClientId=self._client)

    def set_rate(self, hz: int) -> None:
        """Set the step rate; it may change inside an episode."""
        p.setTimeStep(1.0 / hz, physicsClientId=self._client)

    def load_urdf(
        self,
        path: Path,
        pose: Pose,
        *,
        fixed: bool,
        file_inertia: bool = False,
        scale: float = 1.0,
    ) -> int:
        """Load a URDF with its own frame at ``pose`` and return the body.

        ``package://pybullet_data/`` in the file stands for that package's folder.

        Raises:
            RecipeError: if the file cannot be loaded.
        """
        self._refuse_when_sealed("load a body")
        flags = p.URDF_USE_INERTIA_FROM_FILE if file_inertia else 0
        try:
            with muted(1):
                body: int = p.loadURDF(
                    with_packages(path),
                    pose.position,
                    pose.quat_xyzw,
                    useFixedBase=fixed,
                    flags=flags,
                    globalScaling=scale,
                    physicsClientId=self._client,
                )
        except (p.error, OSError) as error:
            raise RecipeError(f"{path.name} cannot be loaded: {error}") from None
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
        with muted(1):
            created = create_compound(self._client, body, pose, mass=mass, scale=scale, rgba=rgba)
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
        self._refuse_when_sealed("add a body")
        body = create_box(self._client, half_extents, position, mass=mass, rgba=rgba)
        self._undamp(body)
        return body

    # -- looks ----------------------------------------------------------------------------

    def set_look(self, body: int, color: Sequence[float], texture: str = "") -> None:
        """Show a body in a colour (RGB, 0 to 1), multiplied with a texture's where one is named.

        Raises:
            UnknownNameError: if there is no such texture.
        """
        set_look(self._client, body, color, self._textures.find(texture))

    def hide(self, body: int) -> Hidden:
        """Leave a body out of all renders until ``show``; its physics stay."""
        return hide(self._client, body)

    def show(self, body: int, hidden: Hidden) -> None:
        """Show a body again as it was."""
        show(self._client, body, hidden)

    def change_dynamics(self, body: int, link: int, **settings: Any) -> None:
        """Set dynamics by PyBullet's own names (``mass``, ``lateralFriction``, ...)."""
        p.changeDynamics(body, link, **settings, physicsClientId=self._client)

    def place_joints(self, body: int, joints: Sequence[int], positions: Sequence[float]) -> None:
        """Set joint positions without moving there; only while the scene is being built."""
        self._refuse_when_sealed("place joints")
        for joint, position in zip(joints, positions, strict=True):
            p.resetJointState(body, joint, position, 0.0, physicsClientId=self._client)

    def gear(self, body: int, parent: int, joints: tuple[int, int], max_force: float) -> None:
        """Couple two mirrored prismatic joints of a body, so that they move as one."""
        links = [p.getJointInfo(body, j, physicsClientId=self._client) for j in joints]
        constraint = p.createConstraint(
            body, joints[0], body, joints[1], p.JOINT_GEAR, links[0][13],
            [0, 0, 0], [0, 0, 0], physicsClientId=self._client,
        )  # fmt: skip
        p.changeConstraint(
            constraint, gearRatio=-1, erp=0.3, maxForce=max_force, physicsClientId=self._client
        )

    def enable_force_torque(self, body: int, joint: int) -> None:
        """Make a fixed joint report the wrench it transmits."""
        p.enableJointForceTorqueSensor(body, joint, True, physicsClientId=self._client)

    def seal(self) -> None:
        """End the building: from here on bodies move by physics alone until ``reset``."""
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

    # -- looking --------------------------------------------------------------------------

    def joint_states(self, body: int, joints: Sequence[int]) -> tuple[Row, ...]:
        """Return (position, velocity, reaction (6,), motor torque) for each joint."""
        return tuple(p.getJointStates(body, joints, physicsClientId=self._client))

    def link_frames(self, body: int, links: Sequence[int]) -> list[Row]:
        """Return (position, quat_xyzw) of each link's URDF frame, world, up to date."""
        states = p.getLinkStates(
            body, links, computeForwardKinematics=1, physicsClientId=self._client
        )
        return [state[4:6] for state in states]

    def link_motion(self, body: int, link: int) -> Row:
        """Return (position, quat_xyzw) of a link's frame, (linear, angular) speed of its COM."""
        return tuple(p.getLinkState(body, link, 1, 1, physicsClientId=self._client)[4:8])

    def com_frame(self, body: int) -> Row:
        """Return (position, quat_xyzw) of a body's inertial frame, which is centred on its COM."""
        return tuple(p.getBasePositionAndOrientation(body, physicsClientId=self._client))

    def velocity(self, body: int) -> Row:
        """Return (linear m/s, angular rad/s) of a body's centre of mass, world."""
        return tuple(p.getBaseVelocity(body, physicsClientId=self._client))

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

    def contacts(self) -> tuple[Row, ...]:
        """Return PyBullet's rows for all contacts, unfiltered.

        Queries filtered by body may flip the friction's sign or drop rows. In a row, [1] and [2]
        are bodies A and B, [3] and [4] their links, [5] and [6] the points on A and B, [7] the
        normal on B pointing to A, [8] the distance, [9] the normal force, [10] and [12] the
        friction forces along [11] and [13]; forces act on A.
        """
        return tuple(p.getContactPoints(physicsClientId=self._client))

    def render(
        self, camera: Camera, light: Light
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
        """Return RGB (H, W, 3), the z-buffer (H, W) and body + (link + 1) * 2^24 (H, W)."""
        return render(self._client, camera, light)

    def _undamp(self, body: int) -> None:
        """Take away the damping that Bullet gives every link (0.04): there is no such air here."""
        for link in (-1, *self._joint_range(body)):
            self.change_dynamics(body, link, linearDamping=0.0, angularDamping=0.0)

    def _info(self, body: int, joint: int) -> Row:
        return tuple(p.getJointInfo(body, joint, physicsClientId=self._client))

    def _joint_range(self, body: int) -> range:
        return range(p.getNumJoints(body, physicsClientId=self._client))

    def _refuse_when_sealed(self, what: str) -> None:
        if self._sealed:
            raise GraspFactoryError(f"cannot {what}: the scene is built, only physics moves it now")
