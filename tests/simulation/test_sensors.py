"""What each sensor measures; ``conformance/test_sensors.py`` has what all of them must do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.scenes import SMALL, cube_spec, default_episodes, tick

from grasp_factory.core import schema
from grasp_factory.core.enums import Label, Phase
from grasp_factory.core.geometry import Pose, apply, quat_xyzw_to_matrix
from grasp_factory.core.sensors import SENSORS
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.scene import build_scene, object_frame
from grasp_factory.simulation.sensors import make_sensor
from grasp_factory.simulation.sensors.tactile import TactilePads
from grasp_factory.simulation.world import World


@pytest.fixture(scope="module")
def world():
    with World() as world:
        yield world


@pytest.fixture(scope="module")
def grasped_cube():
    with World() as world:
        return run_episode(world, cube_spec())


def row(a, b, normal_force=2.0):
    """A contact: B pushes A along +z (N) and along +x, +y (0.5, 0.25 N)."""
    return (0, a[0], b[0], a[1], b[1], (0.1, 0.2, 0.3), (0.4, 0.5, 0.6), (0, 0, 1), -1e-4,
            normal_force, 0.5, (1, 0, 0), 0.25, (0, 1, 0))  # fmt: skip


class TestTactilePads:
    @pytest.fixture
    def setting(self, world):
        scene = build_scene(world, cube_spec())
        pads = TactilePads(scene)

        def touch(*rows):
            pads.sample(tick(scene, rows))
            return pads.arrays()

        left, right = ((scene.robot.body, link) for link in scene.robot.pads)
        frames = world.link_frames(scene.robot.body, scene.robot.pads)
        T_world_pad = [Pose(*frame).matrix() for frame in frames]
        return touch, left, right, (scene.objects[0], -1), T_world_pad

    def test_the_force_is_on_the_pad_whichever_body_comes_first(self, setting):
        touch, left, right, cube, T_world_pad = setting
        streams = touch(row(left, cube), row(cube, right))
        for pad, sign, at in ((0, 1.0, (0.1, 0.2, 0.3)), (1, -1.0, (0.4, 0.5, 0.6))):
            R = T_world_pad[pad][:3, :3]
            force = R @ streams["tactile_force"][0, pad, 0]
            normal = R @ streams["tactile_normal"][0, pad, 0]
            point = apply(T_world_pad[pad], streams["tactile_position"][0, pad, 0].astype(float))
            assert force == pytest.approx(np.array([0.5, 0.25, 2.0]) * sign, abs=1e-6)
            assert normal == pytest.approx(np.array([0, 0, 1.0]) * sign, abs=1e-6)
            assert point == pytest.approx(at, abs=1e-6)

    def test_the_wrench_is_the_sum_over_the_points_about_the_pads_centre(self, setting):
        touch, left, _, cube, _ = setting
        touched = touch(row(left, cube, 2.0), row(cube, left, 3.0), row(left, cube, 5.0))
        streams = {k: v[0, 0].astype(float) for k, v in touched.items()}
        force, point = streams["tactile_force"][:3], streams["tactile_position"][:3]
        assert streams["tactile_wrench"][:3] == pytest.approx(force.sum(axis=0), abs=1e-5)
        moment = np.cross(point, force).sum(axis=0)
        assert streams["tactile_wrench"][3:] == pytest.approx(moment, abs=1e-5)

    def test_a_contact_says_what_it_is_with(self, setting):
        touch, left, right, cube, _ = setting
        bodies = touch(row(left, (1, -1)), row(right, cube))["tactile_body"][0]
        assert bodies[:, 0].tolist() == [Label.TABLE, Label.TARGET]
        assert (bodies[:, 1:] == 0).all()

    def test_contacts_without_force_or_without_a_pad_are_left_out(self, setting):
        touch, left, _, cube, _ = setting
        streams = touch(row(left, cube, 0.0), row(cube, (1, -1)), row((left[0], 3), cube))
        assert np.isnan(streams["tactile_force"]).all()
        assert (streams["tactile_wrench"] == 0).all()

    def test_of_too_many_points_the_strongest_stay_and_the_wrench_has_all(self, setting):
        touch, left, _, cube, T_world_pad = setting
        forces = [float(f) for f in np.random.default_rng(0).permutation(20) + 1]
        streams = touch(*(row(left, cube, f) for f in forces))
        R = T_world_pad[0][:3, :3]
        kept = (streams["tactile_force"][0, 0] @ R.T)[:, 2]
        assert kept == pytest.approx(sorted(forces, reverse=True)[: schema.MAX_CONTACTS], abs=1e-5)
        assert (R @ streams["tactile_wrench"][0, 0, :3])[2] == pytest.approx(sum(forces), abs=1e-4)


def test_what_the_hand_does_to_the_target_beside_the_pads_is_told_apart(world):
    scene = build_scene(world, cube_spec())
    sensor = make_sensor(SENSORS["hand"], scene)
    palm, pad = (scene.robot.body, 9), (scene.robot.body, scene.robot.pads[0])
    cube, table = (scene.objects[0], -1), (1, -1)
    rows = (row(cube, palm), row(pad, cube), row(cube, table), row(palm, table))
    for contacts in (rows, (row(palm, cube),), ()):
        sensor.sample(tick(scene, contacts))
    forces = sensor.arrays()["hand_force"]
    assert forces.tolist() == [[0.5, 0.25, 2.0], [-0.5, -0.25, -2.0], [0.0, 0.0, 0.0]]


def test_a_cube_between_the_pads_is_held_by_them_alone(grasped_cube):
    assert (grasped_cube.streams["hand_force"] == 0).all()


@pytest.mark.parametrize("robot", ROBOTS)
def test_without_contact_the_wrist_carries_the_tools_weight_at_its_centre_of_mass(world, robot):
    model = ROBOTS[robot]
    scene = build_scene(world, cube_spec(robot=robot))
    home = list(model.home)
    scene.robot.command(home, [0.0] * 7, model.gripper.max_width, 240)
    scene.robot.listen(True)
    for _ in range(240):
        world.step()
    sensor = make_sensor(SENSORS["wrist"], scene)
    sensor.sample(tick(scene))
    wrench = sensor.arrays()["wrist_wrench"][0].astype(float)
    weight = scene.robot.T_world_tcp()[:3, :3].T @ [0, 0, -9.81 * model.tool_mass]
    assert wrench[:3] == pytest.approx(weight, abs=0.01 * np.linalg.norm(weight))
    assert wrench[3:] == pytest.approx(np.cross(model.tool_com, weight), abs=0.002)


def test_the_tracker_gives_the_objects_own_frame(world):
    spec = cube_spec()
    duck = dataclasses.replace(
        spec.objects[0], object_id="classic/duck",
        drop_pose=Pose((0.5, 0.1, 0.4), (0.5, 0.5, 0.5, 0.5)),
    )  # fmt: skip
    scene = build_scene(world, dataclasses.replace(spec, objects=(duck,)))
    tracker = make_sensor(SENSORS["tracker"], scene)
    tracker.sample(tick(scene))
    pose = tracker.arrays()["object_pose"][0, 0]
    assert pose[:3] == pytest.approx(duck.drop_pose.position, abs=1e-6)
    assert np.abs(pose[3:] @ duck.drop_pose.quat_xyzw) == pytest.approx(1.0, abs=1e-6)
    frame = object_frame(world, scene.objects[0])
    assert frame.position == pytest.approx(duck.drop_pose.position, abs=1e-9)


def test_the_trackers_frame_is_not_turned_like_the_principal_axes(world):
    spec, pose = cube_spec(), Pose((0.5, 0.1, 0.4), (0.5, 0.5, 0.5, 0.5))
    zed = dataclasses.replace(
        spec.objects[0], object_set="procedural", object_id="procedural/zed/0", drop_pose=pose
    )
    scene = build_scene(world, dataclasses.replace(spec, objects=(zed,)))
    axes = world.inertial_frame(scene.objects[0]).quat_xyzw
    assert 0.1 < abs(axes[3]) < 0.98
    tracker = make_sensor(SENSORS["tracker"], scene)
    tracker.sample(tick(scene))
    found = tracker.arrays()["object_pose"][0, 0]
    assert found[:3] == pytest.approx(pose.position, abs=1e-6)
    assert np.abs(found[3:] @ pose.quat_xyzw) == pytest.approx(1.0, abs=1e-6)


def test_records_are_evenly_spaced_in_simulation_time(grasped_cube):
    gaps = np.diff(grasped_cube.streams["timestamp"])
    assert gaps == pytest.approx(np.full(len(gaps), 1 / SMALL.record_hz), abs=1e-9)
    assert grasped_cube.streams["timestamp"][0] == pytest.approx(1 / SMALL.record_hz)


def test_phases_follow_each_other_in_order(grasped_cube):
    phases = grasped_cube.streams["phase"].astype(int)
    assert (np.diff(phases) >= 0).all()
    assert set(phases) == {int(phase) for phase in Phase}


def test_measured_joints_follow_their_targets(grasped_cube):
    streams = grasped_cube.streams
    error = np.abs(streams["joint_positions"] - streams["joint_position_targets"])
    assert error.max() < 0.02


def test_velocities_are_the_derivative_of_positions(grasped_cube):
    streams = grasped_cube.streams
    moving = streams["phase"] == Phase.PREGRASP
    slope = np.gradient(streams["joint_positions"][moving].astype(float), 1 / 120, axis=0)
    assert streams["joint_velocities"][moving][2:-2] == pytest.approx(slope[2:-2], abs=0.02)


def test_the_commanded_motion_stays_within_the_velocity_limits(grasped_cube):
    limits = np.array(ROBOTS["kuka_iiwa"].joint_velocity_limits)
    for episode in (grasped_cube, *default_episodes(20)):
        if episode.n_steps < 2:
            continue
        targets = episode.streams["joint_position_targets"].astype(float)
        speeds = np.abs(np.diff(targets, axis=0)) * SMALL.record_hz
        assert (speeds <= limits * SMALL.motion.speed_scale + 1e-3).all()


def test_the_tcp_pose_is_the_forward_kinematics_of_the_measured_joints(grasped_cube):
    from grasp_factory.robots import arm_chain

    streams = grasped_cube.streams
    T = arm_chain(ROBOTS["kuka_iiwa"]).fk(streams["joint_positions"].astype(float))
    assert streams["tcp_pose"][:, :3] == pytest.approx(T[:, :3, 3], abs=1e-5)
    for pose, expected in zip(streams["tcp_pose"][::40], T[::40], strict=True):
        assert quat_xyzw_to_matrix(pose[3:]) == pytest.approx(expected[:3, :3], abs=1e-4)
