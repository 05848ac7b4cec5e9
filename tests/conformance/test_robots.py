"""The contract of a robot, which every row of ``ROBOTS`` keeps.

- The home posture lies within the joint limits, looks straight down from behind the workspace,
  and the arm holds it under gravity.
- Kinematics agree with the simulated body, and every place of the workspace is reached from above.
- The pads are parallel to the tool frame, close along its y axis and meet at its origin.
- The fingers close to width 0, and squeeze with the force that is asked for.
- Fingertips, palm, mass and centre of mass of the tool are where the record says.
- The fingers travel no farther, and are no slower, than the bound of every attempt's length allows.
- The facts that a store keeps are plain values that JSON can hold.
"""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig, Stepping
from grasp_factory.core.config.scene import WorkspaceConfig
from grasp_factory.core.geometry import Pose, inverse
from grasp_factory.errors import ConfigError
from grasp_factory.factory.name_check import check_names
from grasp_factory.robots import ROBOTS, arm_chain
from grasp_factory.robots.ik import solve_ik
from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.world import World

DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture
def world():
    with World() as world:
        yield world


@pytest.mark.parametrize("name", ROBOTS)
class TestRobot:
    @pytest.fixture
    def robot(self, world, name):
        world.reset(PhysicsConfig())
        robot = Robot(world, ROBOTS[name])
        world.seal()
        return robot

    def hold_home(self, world, robot, seconds, hz=240, width=None):
        width = robot.model.gripper.max_width if width is None else width
        home = list(robot.model.home)
        robot.command(home, [0.0] * len(home), width, hz)
        world.set_stepping(Stepping(hz, 100, 1, 1e-7))
        for _ in range(round(seconds * hz)):
            world.step()

    def test_home_lies_within_the_joint_limits(self, name):
        chain = arm_chain(ROBOTS[name])
        home = np.array(ROBOTS[name].home)
        assert chain.joint_names == ROBOTS[name].arm_joints
        assert ((chain.lower < home) & (home < chain.upper)).all()

    def test_at_home_the_tcp_looks_down_behind_the_workspace(self, name):
        model = ROBOTS[name]
        T = arm_chain(model).fk(np.array(model.home))
        assert T[:3, 2] == pytest.approx([0, 0, -1], abs=1e-3)
        assert T[0, 3] < 0.40
        assert T[2, 3] > 0.40

    def test_kinematics_agree_with_the_simulated_body(self, world, robot, name):
        T = arm_chain(ROBOTS[name]).fk(robot.arm_positions())
        assert robot.T_world_tcp() == pytest.approx(T, abs=1e-6)

    def test_the_arm_stays_at_home_under_gravity(self, world, robot, name):
        self.hold_home(world, robot, 1.0)
        assert robot.arm_positions() == pytest.approx(robot.model.home, abs=1e-3)

    def test_the_pads_meet_at_the_tcp_and_close_along_y(self, world, robot, name):
        for width in (robot.model.gripper.max_width, robot.model.gripper.max_width / 2):
            self.hold_home(world, robot, 1.0, width=width)
            frames = world.link_frames(robot.body, robot.pads)
            pads = [
                inverse(robot.T_world_tcp()) @ Pose(*frame).matrix() @ offset
                for frame, offset in zip(frames, robot.pad_offsets(), strict=True)
            ]
            assert pads[0][:3, 3] == pytest.approx([0, width / 2, 0], abs=1e-3)
            assert pads[1][:3, 3] == pytest.approx([0, -width / 2, 0], abs=1e-3)
            for T in pads:
                assert T[:3, :3] == pytest.approx(np.eye(3), abs=2e-3)

    def test_the_gripper_closes_on_nothing_to_width_zero(self, world, robot, name):
        self.hold_home(world, robot, 0.1)
        robot.command_grip(speed=0.1, force=20.0)
        for _ in range(480):
            world.step()
        states = world.joint_states(robot.body, robot.fingers)
        assert sum(state[0] for state in states) == pytest.approx(0.0, abs=1e-3)
        assert robot.finger_speed() < 1e-3

    @pytest.mark.parametrize("hz", [240, 960])
    def test_the_fingers_squeeze_with_the_force_that_was_asked_for(self, world, name, hz):
        model = ROBOTS[name]
        world.reset(PhysicsConfig(gravity=0.1))  # so that the box waits for the fingers
        robot = Robot(world, model)
        T = robot.T_world_tcp()
        box = world.add_box((0.015, 0.015, 0.015), T[:3, 3], (1, 1, 1, 1), mass=0.05)
        world.change_dynamics(box, -1, lateralFriction=0.5)
        world.seal()
        world.set_stepping(Stepping(hz, 100, 1, 1e-7))
        home = list(model.home)
        robot.command(home, [0.0] * len(home), 0.032, hz)
        robot.command_grip(speed=0.05, force=20.0)
        for _ in range(hz):
            world.step()
        rows = [c for c in world.contacts() if c[9] > 0 and robot.body in (c[1], c[2])]
        left = sum(c[9] for c in rows if robot.pads[0] in (c[3], c[4]))
        right = sum(c[9] for c in rows if robot.pads[1] in (c[3], c[4]))
        assert left == pytest.approx(20.0, rel=0.02)
        assert right == pytest.approx(20.0, rel=0.02)

    def test_a_force_out_of_the_grippers_range_is_its_nearer_end(self, robot, name, monkeypatch):
        forces = []
        monkeypatch.setattr(World, "command_velocities", lambda *command: forces.append(command[4]))
        for asked in (1e-3, 1e3):
            robot.command_grip(speed=0.05, force=asked)
        low, high = robot.model.gripper.force_range
        assert forces == [[low, low], [high, high]]

    def test_the_stated_tool_mass_and_centre_are_those_of_the_body(self, world, robot, name):
        links = [i for i in world.links(robot.body).values() if i >= robot.first_tool_link]
        frames = [Pose(*frame).matrix() for frame in world.link_frames(robot.body, links)]
        masses = np.array([world.mass(robot.body, link) for link in links])
        coms = [
            (T @ world.inertial_frame(robot.body, link).matrix())[:3, 3]
            for T, link in zip(frames, links, strict=True)
        ]
        com = masses @ np.array(coms) / masses.sum()
        in_sensor = inverse(frames[links.index(robot.first_tool_link)]) @ np.append(com, 1.0)
        assert masses.sum() == pytest.approx(robot.model.tool_mass, rel=1e-6)
        assert in_sensor[:3] == pytest.approx(robot.model.tool_com, abs=1e-5)

    def test_fingertips_and_palm_are_where_the_gripper_record_says(self, world, robot, name):
        """A probe box that overlaps the hand by 2 mm touches it; one 2 mm clear does not."""
        import pybullet

        gripper, T = robot.model.gripper, robot.T_world_tcp()
        half = gripper.max_width / 2
        fingertip = (0.0, half + gripper.finger_thickness / 2, gripper.tip_distance)
        palm = (0.0, 0.0, -gripper.palm_distance)
        for spot in (fingertip, palm):
            for gap, touches in ((0.002, False), (-0.004, True)):
                center = np.add(spot, [0, 0, 0.001 + gap])
                position = (T @ np.append(center, 1.0))[:3]
                world._sealed = False
                probe = world.add_box((0.001, 0.001, 0.001), position, (1, 1, 1, 1))
                found = pybullet.getClosestPoints(
                    robot.body, probe, 0.0, physicsClientId=world._client
                )
                assert bool(found) is touches, (spot, gap)
                pybullet.removeBody(probe, physicsClientId=world._client)

    def test_every_place_of_the_workspace_can_be_reached_from_above(self, name):
        model, box = ROBOTS[name], WorkspaceConfig()
        chain = arm_chain(model)
        low = model.gripper.tip_distance + 0.005
        for x in np.linspace(box.lower[0], box.upper[0], 3):
            for y in np.linspace(box.lower[1], box.upper[1], 3):
                for z in (low, 0.2):
                    T = np.eye(4)
                    T[:3, :3], T[:3, 3] = DOWN, (x, y, z)
                    found = solve_ik(chain, T, np.array(model.home))
                    assert found.success, (x, y, z)

    def test_facts_are_plain_values_that_json_can_hold(self, name):
        facts = ROBOTS[name].facts()
        assert json.loads(json.dumps(facts)) == facts
        assert facts["joint_names"] == list(ROBOTS[name].arm_joints)


@pytest.mark.parametrize("change", [{"max_width": 0.13}, {"max_finger_speed": 0.04}])
def test_a_robot_whose_fingers_would_take_longer_is_refused(monkeypatch, change):
    model = ROBOTS["kuka_iiwa"]
    other = dataclasses.replace(
        model, name="other", gripper=dataclasses.replace(model.gripper, **change)
    )
    monkeypatch.setitem(ROBOTS, "other", other)
    with pytest.raises(ConfigError, match=r"^robot: got 'other', valid: a robot whose fingers"):
        check_names(FactoryConfig(robot="other"))
