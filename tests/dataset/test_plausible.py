"""Episodes that no run writes are refused, whatever their checksums say."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import make_episode, small_config

from grasp_factory.core.enums import label_names
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.plausible import (
    check_calibration,
    check_motion,
    check_plausible,
    pad_size,
)
from grasp_factory.errors import ConfigError

CONFIG = small_config()


def changed(episode: Episode, **spec: Any) -> Episode:
    return dataclasses.replace(episode, spec=dataclasses.replace(episode.spec, **spec))


def test_an_episode_of_the_config_is_plausible() -> None:
    check_plausible(make_episode(CONFIG, 0), CONFIG)


def test_each_object_of_the_scene_may_be_what_was_touched() -> None:
    config = small_config(clutter={"count": 3})
    episode = make_episode(config, 0)
    labels = label_names(3)
    for code in range(len(labels)):
        columns = episode.columns | {"collision_body": code}
        check_plausible(dataclasses.replace(episode, columns=columns), config)
    columns = episode.columns | {"collision_body": len(labels)}
    with pytest.raises(ConfigError, match="collision_body: got 8, valid: below 8"):
        check_plausible(dataclasses.replace(episode, columns=columns), config)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ({"robot": "panda"}, r"spec\.robot: got 'panda', valid: kuka"),
        ({"resolution": (640, 480)}, r"spec\.resolution: got \(640, 480\)"),
        ({"cameras": {}}, "cameras"),
    ],
)
def test_a_recipe_of_another_config_is_refused(spec: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        check_plausible(changed(make_episode(CONFIG, 0), **spec), CONFIG)


def test_other_cameras_are_refused() -> None:
    episode = make_episode(CONFIG, 0)
    other = {"other": next(iter(episode.spec.cameras.values()))}
    with pytest.raises(ConfigError, match=r"spec\.cameras: got \['other'\]"):
        check_plausible(changed(episode, cameras=other), CONFIG)


def test_more_objects_than_there_are_poses_are_refused() -> None:
    episode = make_episode(CONFIG, 0)
    with pytest.raises(ConfigError, match=r"spec\.objects: got 10, valid: up to"):
        check_plausible(changed(episode, objects=episode.spec.objects[:1] * 10), CONFIG)


@pytest.mark.parametrize("focal", [0.0, -300.0, 1e-9, 1e9, np.nan])
def test_focal_lengths_that_no_camera_has_are_refused(focal: float) -> None:
    K = np.diag([300.0, focal, 1.0])
    with pytest.raises(ConfigError, match=r"intrinsics: .* valid: focal lengths of"):
        check_calibration(K, np.eye(4))
    check_calibration(np.diag([300.0, 300.0, 1.0]), np.eye(4))


@pytest.mark.parametrize("position", [np.nan, np.inf, 1e300])
def test_a_camera_that_is_nowhere_is_refused(position: float) -> None:
    pose = np.eye(4)
    pose[0, 3] = position
    with pytest.raises(ConfigError, match=r"T_world_camera: .* valid: positions within"):
        check_calibration(np.diag([300.0, 300.0, 1.0]), np.stack([np.eye(4), pose]))


def test_a_code_without_a_name_is_refused() -> None:
    episode = make_episode(CONFIG, 0)
    columns = {**episode.columns, "collision_body": np.uint8(200)}
    with pytest.raises(ConfigError, match="collision_body: got 200, valid: below"):
        check_plausible(dataclasses.replace(episode, columns=columns), CONFIG)


def moved(timestamp: list[float], joints: float = 0.0, imu: float = 0.0) -> Episode:
    """Return an episode with this clock, these positions of 7 joints, and this time of the IMU."""
    episode = make_episode(CONFIG, 0)
    streams = {"timestamp": np.array(timestamp), "joint_positions": np.full((2, 7), joints)}
    own_rate = {"imu": {**episode.imu, "timestamp": np.full(3, imu)}}
    streams = {**episode.streams, **streams}
    return dataclasses.replace(episode, streams=streams, own_rate=own_rate)


@pytest.mark.parametrize(
    ("timestamp", "joints", "message"),
    [
        ([0.0, np.nan], 0.0, "timestamp"),
        ([0.0, 1e308], 0.0, "timestamp"),
        ([1.0, 0.5], 0.0, "timestamp"),
        ([0.0, 0.5], np.inf, "joint_positions"),
        ([0.0, 0.5], np.nan, "joint_positions"),
    ],
)
def test_a_motion_that_cannot_be_played_is_refused(
    timestamp: list[float], joints: float, message: str
) -> None:
    check_motion(moved([0.0, 0.5]), 7)
    with pytest.raises(ConfigError, match=message):
        check_motion(moved(timestamp, joints), 7)


@pytest.mark.parametrize("time", [np.nan, 1e300, -1e300])
def test_every_clock_of_a_motion_is_checked(time: float) -> None:
    with pytest.raises(ConfigError, match="imu/timestamp: got 'values', valid: seconds"):
        check_motion(moved([0.0, 0.5], imu=time), 7)


@pytest.mark.parametrize("joints", [0, 6, 8])
def test_a_motion_of_another_number_of_joints_is_refused(joints: int) -> None:
    with pytest.raises(ConfigError, match="joint_positions: got '7 joints', valid: "):
        check_motion(moved([0.0, 0.5]), joints)


@pytest.mark.parametrize(
    "robot",
    [
        None, [1], 7, {}, {"pad_size": None}, *({"pad_size": size} for size in (
            [0, 0], [1e308, 1.0], "12", [0.02] * 3, {}, [1e-9, 1.0], [0.02, float("nan")],
            [0.02, 10**400], [True, True],
        )),
    ],
)  # fmt: skip
def test_pads_that_no_robot_has_count_as_unknown(robot: Any) -> None:
    assert pad_size({"robot": robot}) is None
    assert pad_size({}) is None
    assert pad_size({"robot": {"pad_size": [0.02, 1]}}) == (0.02, 1.0)
