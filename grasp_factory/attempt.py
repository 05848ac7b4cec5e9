"""The arm in motion: steps the physics through the phases and samples the sensors."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.motion import GraspMotion, JointSegment, sample
from grasp_factory.outcome import Phase
from grasp_factory.scene import Scene
from grasp_factory.sensors import SENSORS, Tick

STALLED_SPEED = 0.001
"""m/s: fingers slower than this have come to rest."""
STALLED_S = 0.1
"""Seconds for which they must be that slow before the lift begins."""


class Attempt:
    """Executes one planned grasp in a settled scene, recording as it goes."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._sensors = [
            make(scene.world, scene.robot, scene.objects, scene.label_of)
            for make in SENSORS.values()
        ]
        self._time = 0.0
        self._joint_targets: list[float] = list(scene.robot.model.home)
        self._width_target = scene.robot.model.gripper.max_width
        self._contacts: tuple[tuple[Any, ...], ...] = ()
        self.has_closed = False
        """Whether the gripper began to close."""
        self.touched: int | None = None
        """What was touched before the gripper closed, if anything was."""

    def run(self, motion: GraspMotion, width: float) -> None:
        """Go through all phases; stop at an unexpected contact.

        Args:
            motion: Transfer, approach and lift.
            width: Metres between the pads on the approach.
        """
        settings, physics = self._scene.spec.motion, self._scene.spec.physics
        opened = self._width_target
        self._follow(Phase.PREGRASP, motion.transfer, (opened, width))
        if self.touched is None:
            self._follow(Phase.APPROACH, motion.approach, (width, width))
        if self.touched is not None:
            return
        self.has_closed = True
        self._close()
        self._scene.world.set_rate(physics.contact_hz)
        self._follow_gripping(Phase.LIFT, motion.lift)
        if self._pads_touch_target():
            self._wait(Phase.HOLD, settings.hold_s)

    def streams(self) -> dict[str, NDArray[Any]]:
        """Return everything recorded."""
        out: dict[str, NDArray[Any]] = {}
        for sensor in self._sensors:
            out |= sensor.streams()
        return out

    def _follow(self, phase: Phase, segment: JointSegment, width: tuple[float, float]) -> None:
        """Move the arm and open or close the gripper freely, until something is touched."""
        hz = self._scene.spec.physics.free_hz
        self._scene.world.set_rate(hz)
        trajectory = sample(segment, hz, self._scene.spec.record_hz)
        progress = np.linspace(0.0, 1.0, len(trajectory.positions) + 1)[1:]
        widths = (width[0] + (width[1] - width[0]) * progress).tolist()
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        every = hz // self._scene.spec.record_hz
        for i, (positions, velocities) in enumerate(targets):
            self._joint_targets, self._width_target = positions, widths[i]
            self._scene.robot.command(positions, velocities, widths[i], hz)
            self._step(phase, hz, is_record=(i + 1) % every == 0)
            if (i + 1) % every == 0:
                self.touched = self._unexpected_contact()
                if self.touched is not None:
                    return

    def _follow_gripping(self, phase: Phase, segment: JointSegment) -> None:
        hz = self._scene.spec.physics.contact_hz
        trajectory = sample(segment, hz, self._scene.spec.record_hz)
        every = hz // self._scene.spec.record_hz
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        for i, (positions, velocities) in enumerate(targets):
            self._joint_targets = positions
            self._scene.robot.command_arm(positions, velocities, hz)
            self._step(phase, hz, is_record=(i + 1) % every == 0)

    def _close(self) -> None:
        """Close until the fingers stand still."""
        settings, physics = self._scene.spec.motion, self._scene.spec.physics
        robot, hz = self._scene.robot, physics.contact_hz
        self._scene.world.set_rate(hz)
        robot.command_arm(self._joint_targets, [0.0] * len(self._joint_targets), hz)
        robot.command_grip(settings.closing_speed, settings.grip_force)
        self._width_target = 0.0
        slow_records, needed = 0, STALLED_S * self._scene.spec.record_hz

        def is_stalled() -> bool:
            nonlocal slow_records
            slow = robot.finger_speed() < STALLED_SPEED
            slow_records = slow_records + 1 if slow else 0
            return slow_records >= needed

        self._wait(Phase.CLOSE, settings.longest_close_s, is_stalled)

    def _wait(
        self, phase: Phase, seconds: float, is_over: Callable[[], bool] = lambda: False
    ) -> None:
        """Stand still at the contact rate for a time, or until ``is_over`` says so at a record."""
        hz, record_hz = self._scene.spec.physics.contact_hz, self._scene.spec.record_hz
        for _ in range(max(1, round(seconds * record_hz))):
            for i in range(hz // record_hz):
                self._step(phase, hz, is_record=(i + 1) * record_hz == hz)
            if is_over():
                return

    def _step(self, phase: Phase, hz: int, *, is_record: bool) -> None:
        self._scene.world.step()
        self._time += 1.0 / hz
        if not is_record:
            return
        self._contacts = self._scene.world.contacts()
        tick = Tick(self._time, phase, self._joint_targets, self._width_target, self._contacts)
        for sensor in self._sensors:
            sensor.sample(tick)

    def _unexpected_contact(self) -> int | None:
        """Return the label of what the robot touches at the last record, if anything."""
        body = self._scene.robot.body
        for c in self._contacts:
            if c[9] > 0.0 and body in (c[1], c[2]):
                other = (c[2], c[4]) if c[1] == body else (c[1], c[3])
                return self._scene.label_of(*other)
        return None

    def _pads_touch_target(self) -> bool:
        """Return whether any pad touches the target at the last record."""
        robot = self._scene.robot
        pads = {(robot.body, link) for link in robot.pads}
        for c in self._contacts:
            if c[9] > 0.0 and self._scene.objects[0] in (c[1], c[2]):
                if {(c[1], c[3]), (c[2], c[4])} & pads:
                    return True
        return False
