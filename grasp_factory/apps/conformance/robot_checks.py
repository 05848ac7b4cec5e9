"""The checks of a robot, most of them on its simulated body."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.motion import MAX_CLOSING_STROKE, SLOWEST_FINGERS
from grasp_factory.core.config.physics import PhysicsConfig, Stepping
from grasp_factory.core.geometry import Array, Pose, inverse
from grasp_factory.robots import RobotModel, arm_chain
from grasp_factory.robots.ik import solve_ik
from grasp_factory.simulation.robot import Robot
from grasp_factory.simulation.world import World

DOWN = np.diag([1.0, -1.0, -1.0])
"""Rotation of a TCP that looks straight down."""
BEHIND, ABOVE = 0.40, 0.40
"""At home the TCP is nearer to the base than this, and higher, metres."""
CLEARANCE = 0.005
"""Metres between the fingertips and the table at the lowest grasp."""
HIGH = 0.2
"""Height of the highest grasps, metres."""
SQUEEZE = 20.0
"""Force that the fingers are asked for, N."""


def is_within_limits(model: RobotModel) -> str:
    """Check that the home posture lies within the limits of the arm's joints."""
    chain, home = arm_chain(model), np.array(model.home)
    if chain.joint_names != model.arm_joints:
        return f"arm_joints are {model.arm_joints}, valid: {chain.joint_names}"
    ok = len(home) == len(chain.lower) and ((chain.lower < home) & (home < chain.upper)).all()
    limits = list(zip(chain.lower.round(3).tolist(), chain.upper.round(3).tolist(), strict=True))
    return "" if ok else f"home is {model.home}, valid: between {limits}"


def waits_behind(model: RobotModel) -> str:
    """Check that at home the TCP looks straight down from behind the workspace."""
    T = arm_chain(model).fk(np.array(model.home))
    if not np.allclose(T[:3, 2], [0, 0, -1], atol=1e-3):
        return f"at home the TCP looks along {T[:3, 2].round(3).tolist()}, valid: [0, 0, -1]"
    ok = T[0, 3] < BEHIND and T[2, 3] > ABOVE
    valid = f"x below {BEHIND} m and z above {ABOVE} m"
    return "" if ok else f"at home the TCP is at {T[:3, 3].round(3).tolist()} m, valid: {valid}"


def moves_as_computed(model: RobotModel) -> str:
    """Check that kinematics agree with the simulated body."""
    with World() as world:
        robot = _loaded(world, model)
        T = arm_chain(model).fk(robot.arm_positions())
        far = float(np.abs(robot.T_world_tcp() - T).max())
    return "" if far <= 1e-6 else f"the body's TCP differs from the computed one by {far:.2g}"


def holds_still(model: RobotModel) -> str:
    """Check that the arm stays at home under gravity."""
    with World() as world:
        robot = _loaded(world, model)
        _hold_home(world, robot, 1.0, model.gripper.max_width)
        far = float(np.abs(robot.arm_positions() - np.array(model.home)).max())
    return "" if far <= 1e-3 else f"a joint sinks by {far:.2g} rad in a second, valid: up to 0.001"


def closes_at_the_tcp(model: RobotModel) -> str:
    """Check that the pads are parallel to the tool frame, and meet at its origin along y."""
    with World() as world:
        robot = _loaded(world, model)
        for width in (model.gripper.max_width, model.gripper.max_width / 2):
            _hold_home(world, robot, 1.0, width)
            for T, side in zip(_pads(world, robot), (1.0, -1.0), strict=True):
                wanted = np.array([0.0, side * width / 2, 0.0])
                if not np.allclose(T[:3, 3], wanted, atol=1e-3):
                    got = T[:3, 3].round(4).tolist()
                    return f"at width {width:g} m a pad is at {got} m, valid: {wanted.tolist()}"
                if not np.allclose(T[:3, :3], np.eye(3), atol=2e-3):
                    return "the axes of a pad are not parallel to those of the tool frame"
    return ""


def closes_whole(model: RobotModel) -> str:
    """Check that the gripper closes on nothing to width 0."""
    with World() as world:
        robot = _loaded(world, model)
        _hold_home(world, robot, 0.1, model.gripper.max_width)
        robot.command_grip(speed=0.1, force=SQUEEZE)
        for _ in range(480):
            world.step()
        width = sum(state[0] for state in world.joint_states(robot.body, robot.fingers))
        speed = robot.finger_speed()
    if abs(width) > 1e-3:
        return f"it closes to a width of {width:.4f} m, valid: 0"
    return "" if speed < 1e-3 else f"the fingers do not come to rest: {speed:.4f} m/s"


def squeezes(model: RobotModel) -> str:
    """Check that each finger squeezes with the force that is asked for."""
    low, high = model.gripper.force_range
    asked = min(max(SQUEEZE, low), high)
    for hz in (240, 960):
        with World() as world:
            forces = _forces(world, model, asked, hz)
            for side, force in zip(("left", "right"), forces, strict=True):
                if abs(force - asked) > 0.02 * asked:
                    where = f"the {side} finger at {hz} Hz"
                    return f"{where} squeezes with {force:.2f} N, valid: {asked:g}"
    return ""


def weighs_as_stated(model: RobotModel) -> str:
    """Check that mass and centre of mass of the tool are those of the body."""
    with World() as world:
        robot = _loaded(world, model)
        links = [i for i in world.links(robot.body).values() if i >= robot.first_tool_link]
        frames = [Pose(*frame).matrix() for frame in world.link_frames(robot.body, links)]
        masses = np.array([world.mass(robot.body, link) for link in links])
        centers = [
            (T @ world.inertial_frame(robot.body, link).matrix())[:3, 3]
            for T, link in zip(frames, links, strict=True)
        ]
    mass, com = float(masses.sum()), masses @ np.array(centers) / masses.sum()
    at_sensor = (inverse(frames[links.index(robot.first_tool_link)]) @ np.append(com, 1.0))[:3]
    if abs(mass - model.tool_mass) > 1e-6 * mass:
        return f"tool_mass is {model.tool_mass} kg, valid: {mass:.6g}, as the body has"
    ok = np.allclose(at_sensor, model.tool_com, atol=1e-5)
    return "" if ok else f"tool_com is {model.tool_com} m, valid: {at_sensor.round(6).tolist()}"


def reaches(model: RobotModel) -> str:
    """Check that every place of the workspace is reached from above."""
    box, chain = FactoryConfig().workspace, arm_chain(model)
    low = model.gripper.tip_distance + CLEARANCE
    for x in np.linspace(box.lower[0], box.upper[0], 3):
        for y in np.linspace(box.lower[1], box.upper[1], 3):
            for z in (low, HIGH):
                T = np.eye(4)
                T[:3, :3], T[:3, 3] = DOWN, (x, y, z)
                if not solve_ik(chain, T, np.array(model.home)).success:
                    return f"({x:g}, {y:g}, {z:g}) m is not reached from above"
    return ""


def has_plain_facts(model: RobotModel) -> str:
    """Check that the facts that a store keeps are values that JSON can hold."""
    facts = model.facts()
    ok = json.loads(json.dumps(facts)) == facts
    return "" if ok else "a fact changes in JSON: use lists, strings and numbers of Python"


def closes_in_time(model: RobotModel) -> str:
    """Check that the fingers close within the time that an attempt has for it."""
    stroke, speed = model.gripper.max_width / 2.0, model.gripper.max_finger_speed
    ok = stroke <= MAX_CLOSING_STROKE and speed >= SLOWEST_FINGERS
    valid = f"up to {MAX_CLOSING_STROKE:g} m each, with {SLOWEST_FINGERS:g} m/s or more"
    return "" if ok else f"the fingers travel {stroke:g} m with {speed:g} m/s, valid: {valid}"


ROBOT_CHECKS: Mapping[str, Callable[[RobotModel], str]] = {
    "home lies within the joint limits": is_within_limits,
    "at home the TCP looks down behind the workspace": waits_behind,
    "kinematics agree with the simulated body": moves_as_computed,
    "the arm stays at home under gravity": holds_still,
    "the pads meet at the TCP and close along y": closes_at_the_tcp,
    "the gripper closes on nothing to width 0": closes_whole,
    "the fingers squeeze with the force that is asked for": squeezes,
    "mass and centre of the tool are those of the body": weighs_as_stated,
    "every place of the workspace is reached from above": reaches,
    "the facts are plain values": has_plain_facts,
    "the fingers close in the time of an attempt": closes_in_time,
}
"""The checks by what they check. Each returns what is wrong; empty if nothing is."""


def _loaded(world: World, model: RobotModel) -> Robot:
    world.reset(PhysicsConfig())
    robot = Robot(world, model)
    world.seal()
    return robot


def _hold_home(world: World, robot: Robot, seconds: float, width: float, hz: int = 240) -> None:
    home = list(robot.model.home)
    robot.command(home, [0.0] * len(home), width, hz)
    world.set_stepping(Stepping(hz, 100, 1, 1e-7))
    for _ in range(round(seconds * hz)):
        world.step()


def _pads(world: World, robot: Robot) -> list[Array]:
    """Return the poses of left and right pad in the TCP frame, (4, 4) each."""
    frames = world.link_frames(robot.body, robot.pads)
    return [
        inverse(robot.T_world_tcp()) @ Pose(*frame).matrix() @ offset
        for frame, offset in zip(frames, robot.pad_offsets(), strict=True)
    ]


def _forces(world: World, model: RobotModel, force: float, hz: int) -> tuple[float, float]:
    """Return the forces of left and right finger on a box after a second, N."""
    world.reset(PhysicsConfig(gravity=0.1))  # so that the box waits for the fingers
    robot = Robot(world, model)
    center = robot.T_world_tcp()[:3, 3]
    box = world.add_box((0.015, 0.015, 0.015), center.tolist(), (1, 1, 1, 1), mass=0.05)
    world.change_dynamics(box, -1, lateralFriction=0.5)
    world.seal()
    world.set_stepping(Stepping(hz, 100, 1, 1e-7))
    home = list(model.home)
    robot.command(home, [0.0] * len(home), 0.032, hz)
    robot.command_grip(speed=0.05, force=force)
    for _ in range(hz):
        world.step()
    rows = [c for c in world.contacts() if c[9] > 0 and robot.body in (c[1], c[2])]
    left, right = (sum(c[9] for c in rows if pad in (c[3], c[4])) for pad in robot.pads)
    return left, right
