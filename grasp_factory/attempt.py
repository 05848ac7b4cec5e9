"""The arm in motion: steps the physics through the phases and samples the sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.motion import GraspMotion, JointSegment, Trajectory, sample
from grasp_factory.outcome import Phase
from grasp_factory.scene import Scene, look
from grasp_factory.sections import CLOSING_SETTLE_S
from grasp_factory.sensors import SENSORS, Tick, Video, WristImu
from grasp_factory.shaking import plan_shake
from grasp_factory.world import Row

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
        physics = scene.spec.physics
        # Simulation time counts in a unit that both kinds of step are whole multiples of, so that
        # records fall on one even grid, wherever a motion begins or ends.
        self._clock, self._clock_hz = 0, math.lcm(physics.free_hz, physics.contact_hz)
        self._joint_targets: list[float] = list(scene.robot.model.home)
        self._width_target = scene.robot.model.gripper.max_width
        self._shake_level = 0.0
        self._video = Video(lambda: look(scene))
        self._imu = WristImu(scene.world, scene.robot, physics.gravity)
        self.table_penetration = 0.0
        """Deepest overlap of the robot and the table at any record, metres."""
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
        spec, opened = self._scene.spec, self._width_target
        self._follow(Phase.PREGRASP, motion.transfer, (opened, width))
        if self.touched is None:
            self._follow(Phase.APPROACH, motion.approach, (width, width))
        if self.touched is not None:
            return
        self.has_closed = True
        self._close()
        self._follow_gripping(Phase.LIFT, sample(motion.lift, *self._gripping_rates))
        if self._pads_touch_target():
            self._wait(Phase.HOLD, spec.motion.hold_s)
        for level in spec.shake.levels:
            if self._pads_touch_target():
                self._shake(level)

    def imu(self) -> dict[str, NDArray[Any]]:
        """Return the IMU's series."""
        return self._imu.series()

    def videos(self) -> dict[str, NDArray[Any]]:
        """Return the videos; nothing where none was asked for."""
        spec = self._scene.spec
        if not spec.video_hz:
            return {}
        return self._video.series(dict.fromkeys(spec.cameras, spec.resolution))

    def streams(self) -> dict[str, NDArray[Any]]:
        """Return everything recorded."""
        out: dict[str, NDArray[Any]] = {}
        for sensor in self._sensors:
            out |= sensor.streams()
        return out

    @property
    def _gripping_rates(self) -> tuple[int, int]:
        """Physics and control rate, Hz, from the closing on."""
        return self._scene.spec.physics.contact_hz, self._scene.spec.physics.control_hz

    def _follow(self, phase: Phase, segment: JointSegment, width: tuple[float, float]) -> None:
        """Move the arm and open or close the gripper freely, until something is touched."""
        hz = self._scene.spec.physics.free_hz
        self._scene.world.set_rate(hz)
        trajectory = sample(segment, hz, self._scene.spec.physics.control_hz)
        progress = np.linspace(0.0, 1.0, len(trajectory.positions) + 1)[1:]
        widths = (width[0] + (width[1] - width[0]) * progress).tolist()
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        for (positions, velocities), opening in zip(targets, widths, strict=True):
            self._joint_targets, self._width_target = positions, opening
            self._scene.robot.command(positions, velocities, opening, hz)
            self._step(phase, hz)
            self.touched = self._unexpected_contact()
            if self.touched is not None:
                return

    def _follow_gripping(self, phase: Phase, trajectory: Trajectory) -> None:
        hz = self._scene.spec.physics.contact_hz
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        for positions, velocities in targets:
            self._joint_targets = positions
            self._scene.robot.command_arm(positions, velocities, hz)
            self._step(phase, hz)

    def _shake(self, level: float) -> None:
        """Go through the motions of one level, until the target is lost."""
        self._shake_level = level
        robot, posture = self._scene.robot, np.array(self._joint_targets)
        shake = self._scene.spec.shake
        for motion in plan_shake(robot.chain, posture, level, shake, self._gripping_rates):
            self._follow_gripping(Phase.SHAKE, motion)
            if not self._pads_touch_target():
                return

    def _close(self) -> None:
        """Close until the fingers stand still."""
        settings, physics = self._scene.spec.motion, self._scene.spec.physics
        robot, hz = self._scene.robot, physics.contact_hz
        self._scene.world.set_rate(hz)
        robot.command_arm(self._joint_targets, [0.0] * len(self._joint_targets), hz)
        robot.command_grip(settings.closing_speed, settings.grip_force)
        self._width_target = 0.0
        slow_for, needed = 0, STALLED_S * physics.control_hz

        def is_stalled() -> bool:
            nonlocal slow_for
            slow_for = slow_for + 1 if robot.finger_speed() < STALLED_SPEED else 0
            return slow_for >= needed

        gripper = robot.model.gripper
        speed = min(settings.closing_speed, gripper.max_finger_speed)
        longest = gripper.max_width / 2.0 / speed + CLOSING_SETTLE_S
        self._wait(Phase.CLOSE, longest, is_stalled)

    def _wait(
        self, phase: Phase, seconds: float, is_over: Callable[[], bool] = lambda: False
    ) -> None:
        """Stand still for a time, or until ``is_over``, asked at the control rate, says so."""
        hz, control_hz = self._gripping_rates
        for _ in range(math.ceil(seconds * control_hz)):
            for _ in range(hz // control_hz):
                self._step(phase, hz)
            if is_over():
                return

    def _step(self, phase: Phase, hz: int) -> None:
        """Make a step, and sample what is due after it."""
        self._scene.world.step()
        self._clock += self._clock_hz // hz
        time = self._clock / self._clock_hz
        if self._is_due(self._scene.spec.imu_hz):
            self._imu.sample(time)
        if self._scene.spec.video_hz and self._is_due(self._scene.spec.video_hz):
            self._video.sample(time)
        if not self._is_due(self._scene.spec.record_hz):
            return
        contacts = self._scene.world.contacts()
        self._watch_table(contacts)
        tick = Tick(
            timestamp=time,
            phase=phase,
            joint_position_targets=self._joint_targets,
            gripper_width_target=self._width_target,
            shake_level=self._shake_level,
            contacts=contacts,
        )
        for sensor in self._sensors:
            sensor.sample(tick)

    def _is_due(self, hz: int) -> bool:
        return self._clock % (self._clock_hz // hz) == 0

    def _watch_table(self, contacts: Iterable[Row]) -> None:
        """Note how deep the robot is in the table at this record; its foot stands there."""
        robot = self._scene.robot.body
        for c in contacts:
            if c[2] == self._scene.stage.table and c[1] == robot and c[3] >= 0:
                self.table_penetration = max(self.table_penetration, -c[8])
            elif c[1] == self._scene.stage.table and c[2] == robot and c[4] >= 0:
                self.table_penetration = max(self.table_penetration, -c[8])

    def _unexpected_contact(self) -> int | None:
        """Return the label of what the robot touches, if anything."""
        body = self._scene.robot.body
        for c in self._scene.world.contacts():
            if c[9] > 0.0 and body in (c[1], c[2]):
                other = (c[2], c[4]) if c[1] == body else (c[1], c[3])
                return self._scene.label_of(*other)
        return None

    def _pads_touch_target(self) -> bool:
        """Return whether any pad touches the target."""
        robot = self._scene.robot
        pads = {(robot.body, link) for link in robot.pads}
        for c in self._scene.world.contacts():
            if c[9] > 0.0 and self._scene.objects[0] in (c[1], c[2]):
                if {(c[1], c[3]), (c[2], c[4])} & pads:
                    return True
        return False
