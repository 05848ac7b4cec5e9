"""The wrist's IMU against Newton."""

from __future__ import annotations

import numpy as np
import pytest
from support.scenes import SMALL, cube_spec

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.enums import Phase
from grasp_factory.core.geometry import pose_matrices, quat_xyzw_to_matrix
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World


@pytest.fixture(scope="module", params=list(ROBOTS))
def episode(request):
    with World() as world:
        return run_episode(world, cube_spec(robot=request.param))


def during(episode, phase):
    """Return which IMU samples lie in a phase, its first fifth left out."""
    times = episode.streams["timestamp"][episode.streams["phase"] == phase]
    first = times[0] + 0.2 * (times[-1] - times[0])
    return (episode.imu["timestamp"] > first) & (episode.imu["timestamp"] <= times[-1])


def test_at_rest_it_reads_gravity_upwards_within_a_thousandth(episode):
    rest = during(episode, Phase.HOLD)
    force = episode.imu["specific_force"][rest]
    pose = episode.streams["tcp_pose"][episode.streams["phase"] == Phase.HOLD][-1]
    upwards = force @ quat_xyzw_to_matrix(pose[3:]).T
    assert np.linalg.norm(upwards - [0, 0, 9.81], axis=1).max() < 0.001 * 9.81
    assert np.abs(episode.imu["angular_velocity"][rest]).max() < 1e-3


def test_integrated_twice_it_gives_the_way_of_the_lift(episode):
    times = episode.streams["timestamp"][episode.streams["phase"] == Phase.LIFT]
    lift = (episode.imu["timestamp"] > times[0] - 1 / 120) & (
        episode.imu["timestamp"] <= times[-1] + 0.1
    )
    pose = episode.streams["tcp_pose"][episode.streams["phase"] == Phase.LIFT][0]
    up = episode.imu["specific_force"][lift].astype(float) @ quat_xyzw_to_matrix(pose[3:]).T
    period = 1 / SMALL.imu_rate
    way = np.cumsum(np.cumsum((up[:, 2] - 9.81) * period) * period)
    assert way[-1] == pytest.approx(SMALL.motion.lift_height, abs=0.004)


@pytest.mark.parametrize("robot", ROBOTS)
def test_while_the_hand_turns_it_moves_as_its_own_frame_does(robot):
    hz = 240
    with World() as world:
        episode = run_episode(world, cube_spec(robot=robot, record_hz=hz, imu_hz=hz))
    turning = episode.streams["phase"] == Phase.PREGRASP
    T = pose_matrices(episode.streams["tcp_pose"][turning]) @ episode.imu["T_tcp_imu"]
    force = episode.imu["specific_force"][: len(T)].astype(float)
    acceleration = np.einsum("nij,nj->ni", T[:, :3, :3], force) - [0, 0, 9.81]
    velocity = np.cumsum(acceleration, axis=0) / hz
    assert np.abs(velocity).max() > 0.3
    assert velocity[1:] == pytest.approx(np.diff(T[:, :3, 3], axis=0) * hz, abs=0.004)


def test_its_samples_are_evenly_spaced_on_the_streams_clock(episode):
    gaps = np.diff(episode.imu["timestamp"])
    assert gaps == pytest.approx(np.full(len(gaps), 1 / SMALL.imu_rate), abs=1e-9)
    behind = episode.imu["timestamp"][-1] - episode.streams["timestamp"][-1]
    assert 0.0 <= behind < 1 / SMALL.record_hz


def test_it_sits_behind_the_tcp_on_the_approach_axis(episode):
    T = episode.imu["T_tcp_imu"]
    assert T[:3, :3] == pytest.approx(np.eye(3), abs=1e-6)
    assert T[:2, 3] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert T[2, 3] < -0.05


@pytest.mark.parametrize(
    ("rates", "expected"),
    [((240, 960), 240), ((400, 800), 400), ((480, 960), 480), ((1200, 1200), 400)],
)
def test_its_rate_is_the_nearest_to_400_hz_that_the_physics_allow(rates, expected):
    physics = PhysicsConfig(free_hz=rates[0], contact_hz=rates[1])
    assert FactoryConfig(physics=physics, record_hz=40).imu_rate == expected
