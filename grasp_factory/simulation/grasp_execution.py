"""Execute a planned grasp: step the physics through its phases and sample the sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.motion import CLOSING_SETTLE_S, STALLED_S
from grasp_factory.core.config.physics import Stepping
from grasp_factory.core.enums import Phase
from grasp_factory.core.sensors import PLUGIN_SENSORS, SENSORS, STREAMS
from grasp_factory.robots.shake import plan_shake
from grasp_factory.robots.trajectory import GraspMotion, JointSegment, Trajectory, sample
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors import Tick, make_sensors
from grasp_factory.simulation.world import EngineRow, wake

STALLED_SPEED = 0.001
"""Fingers slower than this are at rest, m/s."""


class Attempt:
    """Executes one planned grasp in a settled scene, and records it."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._sensors = make_sensors(scene)
        spec, physics = scene.spec, scene.spec.physics
        # Both step lengths are multiples of the clock's unit, so samples are evenly spaced even
        # where the step length changes.
        self._clock, self._clock_hz = 0, math.lcm(physics.free_hz, physics.contact_hz)
        self._record_every = self._clock_hz // spec.record_hz
        # Sensors with their own rate are sampled before those of the records.
        self._models = {**SENSORS, **PLUGIN_SENSORS}
        order = sorted(self._sensors, key=lambda name: self._models[name].group == STREAMS)
        self._schedule = [
            (self._clock_hz // self._models[name].group.rate(spec), self._sensors[name])
            for name in order
        ]
        self._joint_targets: Sequence[float] = list(scene.robot.model.home)
        self._width_target = scene.robot.model.gripper.max_width
        self._shake_level = 0.0
        self.table_penetration = 0.0
        """Deepest overlap of the robot and the table over all records, metres."""
        self.has_closed = False
        """Whether the gripper began to close."""
        self.touched: int | None = None
        """Label of what the robot touched before the gripper closed; None without contact."""

    def run(self, motion: GraspMotion, width: float) -> None:
        """Execute all phases; stop at an unexpected contact.

        Args:
            motion: Transfer, approach and lift.
            width: Distance between the pads during the approach, metres.
        """
        spec, opened = self._scene.spec, self._width_target
        self._set_stepping(spec.physics.free)
        self._follow(Phase.PREGRASP, motion.transfer, (opened, width))
        if self.touched is None:
            self._follow(Phase.APPROACH, motion.approach, (width, width))
        if self.touched is not None:
            return
        self.has_closed = True
        self._close()
        self._follow_gripping(Phase.LIFT, sample(motion.lift, self._hz, spec.physics.control_hz))
        if self._pads_touch_target():
            self._wait(Phase.HOLD, spec.motion.hold_s)
        for level in spec.shake.levels:
            if self._pads_touch_target():
                self._shake(level)

    def series(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the arrays of all sensors, by their group and name."""
        out: dict[str, dict[str, NDArray[Any]]] = {}
        for name, sensor in self._sensors.items():
            out.setdefault(self._models[name].group.name, {}).update(sensor.arrays())
        return out

    def _follow(self, phase: Phase, segment: JointSegment, width: tuple[float, float]) -> None:
        """Move the arm and the gripper along a segment; stop at the first contact of the robot."""
        trajectory = sample(segment, self._hz, self._scene.spec.physics.control_hz)
        progress = np.linspace(0.0, 1.0, len(trajectory.positions) + 1)[1:]
        widths = (width[0] + (width[1] - width[0]) * progress).tolist()
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        for (positions, velocities), opening in zip(targets, widths, strict=True):
            self._joint_targets, self._width_target = positions, opening
            self._scene.robot.command(positions, velocities, opening, self._hz)
            self._step(phase)
            self.touched = self._unexpected_contact()
            if self.touched is not None:
                return

    def _follow_gripping(self, phase: Phase, trajectory: Trajectory) -> None:
        targets = zip(trajectory.positions.tolist(), trajectory.velocities.tolist(), strict=True)
        for positions, velocities in targets:
            self._joint_targets = positions
            self._scene.robot.command_arm(positions, velocities, self._hz)
            self._step(phase)

    def _shake(self, level: float) -> None:
        """Execute the motions of one level; stop when the target is lost."""
        self._shake_level = level
        robot, posture = self._scene.robot, np.array(self._joint_targets)
        shake, rates = self._scene.spec.shake, (self._hz, self._scene.spec.physics.control_hz)
        for motion in plan_shake(robot.chain, posture, level, shake, rates):
            self._follow_gripping(Phase.SHAKE, motion)
            if not self._pads_touch_target():
                return

    def _close(self) -> None:
        """Close the gripper until its fingers stop."""
        settings, physics = self._scene.spec.motion, self._scene.spec.physics
        robot = self._scene.robot
        self._width_target = 0.0
        slow_for, needed = 0, STALLED_S * physics.control_hz

        def is_stalled() -> bool:
            nonlocal slow_for
            slow_for = slow_for + 1 if robot.finger_speed() < STALLED_SPEED else 0
            return slow_for >= needed

        gripper = robot.model.gripper
        speed = min(settings.closing_speed, gripper.max_finger_speed)
        longest = gripper.max_width / 2.0 / speed + CLOSING_SETTLE_S
        self._grip(physics.free)
        passed = self._wait(Phase.CLOSE, longest, lambda: self._is_near() or is_stalled())
        wake(self._scene.world, self._scene.objects)
        self._grip(physics.contact)
        self._wait(Phase.CLOSE, longest - passed, is_stalled)

    def _grip(self, stepping: Stepping) -> None:
        """Close the gripper while the arm stays still, and use this stepping from now on.

        The engine converts a motor's force into an impulse per step when the command is set. So
        all motors are commanded again when the rate changes.
        """
        robot, settings = self._scene.robot, self._scene.spec.motion
        self._set_stepping(stepping)
        robot.command_arm(self._joint_targets, [0.0] * len(self._joint_targets), self._hz)
        robot.command_grip(settings.closing_speed, settings.grip_force)

    def _wait(
        self, phase: Phase, seconds: float, is_over: Callable[[], bool] = lambda: False
    ) -> float:
        """Step for a time (s), or until ``is_over`` is true; it is called at the control rate.

        Returns:
            The seconds that passed.
        """
        control_hz = self._scene.spec.physics.control_hz
        periods = math.ceil(seconds * control_hz)
        for period in range(1, periods + 1):
            for _ in range(self._hz // control_hz):
                self._step(phase)
            if is_over():
                return period / control_hz
        return periods / control_hz

    def _set_stepping(self, stepping: Stepping) -> None:
        self._hz, self._ticks = stepping.hz, self._clock_hz // stepping.hz
        self._scene.world.set_stepping(stepping)

    def _step(self, phase: Phase) -> None:
        """Make a step, and sample the sensors that are due after it."""
        self._clock += self._ticks
        is_record = self._clock % self._record_every == 0
        if is_record:
            self._scene.robot.listen(True)
        self._scene.world.step()
        due = [sensor for every, sensor in self._schedule if self._clock % every == 0]
        if due:
            tick = self._tick(phase)
            for sensor in due:
                sensor.sample(tick)
        if is_record:
            self._watch_table(tick.contacts)
            self._scene.robot.listen(False)

    def _tick(self, phase: Phase) -> Tick:
        return Tick(
            scene=self._scene,
            timestamp=self._clock / self._clock_hz,
            phase=phase,
            joint_position_targets=self._joint_targets,
            gripper_width_target=self._width_target,
            shake_level=self._shake_level,
        )

    def _watch_table(self, contacts: Iterable[EngineRow]) -> None:
        """Update the deepest overlap of table and robot, without its base: that is on the table."""
        robot = self._scene.robot.body
        for c in contacts:
            if c[2] == self._scene.stage.table and c[1] == robot and c[3] >= 0:
                self.table_penetration = max(self.table_penetration, -c[8])
            elif c[1] == self._scene.stage.table and c[2] == robot and c[4] >= 0:
                self.table_penetration = max(self.table_penetration, -c[8])

    def _unexpected_contact(self) -> int | None:
        """Return the label of a body that the robot touches; None without contact."""
        body = self._scene.robot.body
        for c in self._scene.world.contacts():
            if c[9] > 0.0 and body in (c[1], c[2]):
                other = (c[2], c[4]) if c[1] == body else (c[1], c[3])
                return self._scene.label_of(*other)
        return None

    def _is_near(self) -> bool:
        """Return whether a body is within the engine's contact margin of the robot."""
        body = self._scene.robot.body
        return any(body in (c[1], c[2]) for c in self._scene.world.contacts())

    def _pads_touch_target(self) -> bool:
        """Return whether any pad touches the target."""
        robot = self._scene.robot
        pads = {(robot.body, link) for link in robot.pads}
        for c in self._scene.world.contacts():
            if c[9] > 0.0 and self._scene.objects[0] in (c[1], c[2]):
                if {(c[1], c[3]), (c[2], c[4])} & pads:
                    return True
        return False
