"""The contract of a robot, which every row of ``ROBOTS`` keeps.

Most checks are those of ``grasp-factory conformance``: see ``robot_checks``. They say:

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

import numpy as np
import pytest

from grasp_factory.apps.conformance.robot_checks import ROBOT_CHECKS
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.errors import ConfigError
from grasp_factory.factory.name_check import check_names
from grasp_factory.robots import ROBOTS
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

    def test_a_force_out_of_the_grippers_range_is_its_nearer_end(self, robot, name, monkeypatch):
        forces = []
        monkeypatch.setattr(World, "command_velocities", lambda *command: forces.append(command[4]))
        for asked in (1e-3, 1e3):
            robot.command_grip(speed=0.05, force=asked)
        low, high = robot.model.gripper.force_range
        assert forces == [[low, low], [high, high]]

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


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("check", ROBOT_CHECKS)
def test_every_robot_passes(check, name):
    assert ROBOT_CHECKS[check](ROBOTS[name]) == ""


IIWA = ROBOTS["kuka_iiwa"]
CHANGES = {
    "home lies within the joint limits": {"home": (9.0, *IIWA.home[1:])},
    "at home the TCP looks down behind the workspace": {"home": (0.0, *[0.5] * 6)},
    "the pads meet at the TCP and close along y": {"pad_center": (0.0, 0.02, 0.0)},
    "mass and centre of the tool are those of the body": {"tool_mass": 2.0},
    "the facts are plain values": {"tool_com": tuple(np.zeros(3, np.float32))},
}
"""For some checks, changes of a robot that fails it."""


@pytest.mark.parametrize("check", CHANGES)
def test_a_robot_that_breaks_a_rule_is_found(check):
    try:
        fault = ROBOT_CHECKS[check](dataclasses.replace(IIWA, **CHANGES[check]))
    except TypeError as error:  # JSON cannot hold the value
        fault = str(error)
    assert fault
    assert "\n" not in fault


@pytest.mark.parametrize("change", [{"max_width": 0.13}, {"max_finger_speed": 0.04}])
def test_a_robot_whose_fingers_would_take_longer_is_refused(monkeypatch, change):
    model = ROBOTS["kuka_iiwa"]
    other = dataclasses.replace(
        model, name="other", gripper=dataclasses.replace(model.gripper, **change)
    )
    monkeypatch.setitem(ROBOTS, "other", other)
    with pytest.raises(ConfigError, match=r"^robot: got 'other', valid: a robot whose fingers"):
        check_names(FactoryConfig(robot="other"))
