"""The driver of any robot in a world: loads the model, commands joints, reads their states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasp_factory.core.geometry import IDENTITY, Array, Pose, transform
from grasp_factory.core.linear import product
from grasp_factory.robots import RobotModel, arm_chain
from grasp_factory.robots.kinematics import carrier
from grasp_factory.simulation.world import EngineRow, World

TRACKING_BANDWIDTH = 48.0
"""Bandwidth of the joint position loop, rad/s: a gain of 0.2 per step at 240 Hz. With a fixed gain
per step, the arm would be stiffer at finer steps, and the labels would depend on the rate."""
GEAR_FORCE = 200.0
"""Largest force that keeps the two fingers symmetric, N (bullet3 issue 2101 advises a gear)."""


class Robot:
    """A robot in a world; it starts in its home position with the gripper open."""

    def __init__(self, world: World, model: RobotModel) -> None:
        self.model = model
        self.chain = arm_chain(model)
        self._world = world
        self.body = world.load_urdf(
            model.path(), IDENTITY, fixed=True, file_inertia=model.file_inertia
        )
        joints, links = world.joints(self.body), world.links(self.body)
        self.arm = [joints[name] for name in model.arm_joints]
        self.fingers = [joints[name] for name in model.finger_joints]
        self.pads = [links[name] for name in model.pad_links]
        hand, self.T_hand_tcp = carrier(model.path(), model.tcp_link, links)
        self.hand = links[hand]
        self.ft_joint = joints[model.ft_joint]
        self.first_tool_link = links[model.first_tool_link]
        half = model.gripper.max_width / 2.0
        world.place_joints(self.body, self.arm, model.home)
        world.place_joints(self.body, self.fingers, [half, half])
        # Torsion comes from friction at several points. Bullet's own torsional friction would not
        # be in the contact rows, and the pads' wrench would be incomplete.
        for pad in self.pads:
            world.change_dynamics(
                self.body, pad, lateralFriction=model.pad_friction,
                spinningFriction=0.0, rollingFriction=0.0, frictionAnchor=1,
            )  # fmt: skip
        left, right = self.fingers
        world.gear(self.body, -1, (left, right), GEAR_FORCE)

    def command(
        self, positions: Sequence[float], velocities: Sequence[float], width: float, hz: int
    ) -> None:
        """Command the arm (J values each, rad and rad/s) and the gripper's width (m)."""
        self._world.command_positions(
            self.body,
            [*self.arm, *self.fingers],
            [*positions, width / 2.0, width / 2.0],
            [*velocities, 0.0, 0.0],
            forces=[*self.model.joint_torque_limits, *[self.model.gripper.force_range[1]] * 2],
            gain=TRACKING_BANDWIDTH / hz,
        )

    def command_arm(self, positions: Sequence[float], velocities: Sequence[float], hz: int) -> None:
        """Command the arm alone; the gripper keeps its last command."""
        self._world.command_positions(
            self.body,
            self.arm,
            positions,
            velocities,
            forces=self.model.joint_torque_limits,
            gain=TRACKING_BANDWIDTH / hz,
        )

    def command_grip(self, speed: float, force: float) -> None:
        """Close with ``speed`` (m/s per finger) and at most ``force`` (N per finger)."""
        speed = min(speed, self.model.gripper.max_finger_speed)
        low, high = self.model.gripper.force_range
        force = min(max(force, low), high)
        self._world.command_velocities(self.body, self.fingers, [-speed, -speed], [force, force])

    def listen(self, on: bool) -> None:
        """Switch the wrist's force-torque sensor on or off, from the next step on.

        It takes a seventh of the time of a free step, so it is on only in steps after which it is
        read.
        """
        self._world.sense_wrench(self.body, self.ft_joint, on)

    def joint_states(self) -> tuple[EngineRow, ...]:
        """Return the states of the arm's joints, the fingers' and the wrist sensor's."""
        return self._world.joint_states(self.body, [*self.arm, *self.fingers, self.ft_joint])

    def frames(self) -> list[EngineRow]:
        """Return position and quat_xyzw of the hand, which carries the TCP, and of both pads."""
        return self._world.link_frames(self.body, [self.hand, *self.pads])

    def finger_speed(self) -> float:
        """Return the faster finger's speed, m/s."""
        states = self._world.joint_states(self.body, self.fingers)
        return float(max(abs(state[1]) for state in states))

    def arm_positions(self) -> Array:
        """Return the measured joint positions (J,), rad."""
        return np.array([s[0] for s in self._world.joint_states(self.body, self.arm)])

    def T_world_tcp(self) -> Array:
        """Return the measured TCP pose (4, 4)."""
        position, quat = self._world.link_frames(self.body, [self.hand])[0]
        return product(Pose(position, quat).matrix(), self.T_hand_tcp)

    def pad_offsets(self) -> Array:
        """Return ``T_link_pad`` of both pads, (2, 4, 4): left, right."""
        x, y, z = self.model.pad_center
        return np.stack([transform(np.eye(3), (x, y, z)), transform(np.eye(3), (x, -y, z))])
