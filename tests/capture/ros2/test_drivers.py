"""The drivers of topics, in a process of their own, against the episode that is played."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.network_namespace import Namespace
from support.places import TINY
from support.topic_commands import TopicCommands, ended

from grasp_factory.capture.devices import DEVICES
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError
from grasp_factory.writers.exporters.images import depth_to_uint16

CAMERA = "/cameras/front"
START_NS = 10**9
pytestmark = [pytest.mark.slow, pytest.mark.soak]
DRIVERS: dict[str, tuple[dict[str, Any], int]] = {
    "ros2_imu": ({"topic": "/imu/data"}, 768),
    "ros2_force_torque": ({"topic": "/wrist/wrench"}, 384),
    "ros2_joints": ({"topic": "/joint_states", "command_topic": "/joint_targets"}, 384),
    "ros2_camera": (
        {"topic": f"{CAMERA}/color/image_raw", "depth_topic": f"{CAMERA}/depth/image_raw"},
        2,
    ),
}
"""Settings and number of samples of the episode."""
WAIT = {"match_s": 60.0}


@pytest.fixture(scope="module")
def heard(namespace: Namespace, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the arrays that all drivers yield while an episode is played."""
    folder = tmp_path_factory.mktemp("heard")
    commands = TopicCommands(namespace)
    try:
        readers = [
            commands.start_python(
                "support.topic_reader",
                name,
                json.dumps(settings | WAIT),
                count,
                folder / f"{name}.npz",
            )
            for name, (settings, count) in DRIVERS.items()
        ]
        names = [topic for settings, _ in DRIVERS.values() for topic in settings.values()]
        code, _, complaint = commands.run(
            "publish", TINY, 1, "--topics", ",".join(names), "--wait-for-all", "--wait", 60
        )
        assert (code, complaint) == (0, "")
        assert [ended(reader)[::2] for reader in readers] == [(0, "")] * len(readers)
    finally:
        commands.kill()
    return {name: dict(np.load(folder / f"{name}.npz")) for name in DRIVERS}


@pytest.fixture(scope="module")
def episode() -> Any:
    return Dataset(TINY)[1]


def stamps(seconds: Any) -> Any:
    return np.rint(seconds * 1e9).astype(np.int64) + START_NS


def test_the_imu_is_that_of_the_episode(heard: Any, episode: Any) -> None:
    found = heard["ros2_imu"]
    for name in ("specific_force", "angular_velocity"):
        np.testing.assert_array_equal(found[name], episode.imu[name])
    np.testing.assert_array_equal(found["device_ns"], stamps(episode.imu["timestamp"]))


def test_the_wrench_is_that_of_the_episode(heard: Any, episode: Any) -> None:
    found = heard["ros2_force_torque"]
    np.testing.assert_array_equal(found["wrench"], episode.streams["wrist_wrench"])
    np.testing.assert_array_equal(found["device_ns"], stamps(episode.streams["timestamp"]))


def test_the_joints_are_those_of_the_episode(heard: Any, episode: Any) -> None:
    found = heard["ros2_joints"]
    for name, stored in (
        ("positions", "joint_positions"),
        ("velocities", "joint_velocities"),
        ("torques", "joint_torques"),
    ):
        np.testing.assert_array_equal(found[name], episode.streams[stored])
    targets = found["position_targets"]
    assert set(map(tuple, targets[np.isfinite(targets).all(1)])) <= set(
        map(tuple, episode.streams["joint_position_targets"].astype(np.float64))
    )
    there = np.isfinite(targets).all(1)  # before the first command comes there is none
    assert there.any()
    assert there[there.argmax() :].all()


def test_the_images_are_those_of_the_episode(heard: Any, episode: Any) -> None:
    found, frames = heard["ros2_camera"], episode.cameras["front"]
    np.testing.assert_array_equal(found["rgb"], frames.rgb)
    np.testing.assert_array_equal(found["depth"], depth_to_uint16(frames.depth, 1e-3))


def test_samples_have_the_hosts_time_in_order(heard: Any) -> None:
    for found in heard.values():
        assert (np.diff(found["host_ns"]) >= 0).all()


@pytest.mark.parametrize(
    ("name", "settings", "said"),
    [
        ("ros2_imu", {}, "missing key 'ros2_imu.topic'"),
        ("ros2_imu", {"topic": "/a", "domain_id": 900}, "domain_id: got 900, valid: 0 to 232"),
        ("ros2_imu", {"topic": "/a", "rate": 3}, "unknown key 'ros2_imu.rate'"),
        ("ros2_camera", {"topic": "/a", "depth_topic": "/a"}, "valid: another topic"),
        ("ros2_joints", {"topic": "/a", "command_topic": "/a"}, "valid: another topic"),
    ],
)
def test_settings_that_cannot_be_are_refused(
    name: str, settings: dict[str, Any], said: str
) -> None:
    with pytest.raises(ConfigError, match=said):
        DEVICES[name].make(settings)


def test_without_a_publisher_opening_fails_in_one_line(
    topics: TopicCommands, tmp_path: Path
) -> None:
    settings = json.dumps({"topic": "/imu/data", "match_s": 0.3})
    reader = topics.start_python("support.topic_reader", "ros2_imu", settings, 1, tmp_path / "a")
    code, said, _ = ended(reader)
    assert code == 1
    assert said.startswith("CaptureError: nobody publishes /imu/data within 0.3 s")


def test_a_topic_of_another_type_is_refused(topics: TopicCommands, tmp_path: Path) -> None:
    settings = json.dumps({"topic": "/wrist/wrench"} | WAIT)
    topics.start("publish", TINY, 0, "--topics", "/wrist/wrench", "--wait", 60)
    reader = topics.start_python("support.topic_reader", "ros2_imu", settings, 1, tmp_path / "a")
    code, said, _ = ended(reader)
    assert code == 1
    assert said == (
        "CaptureError: /wrist/wrench: got geometry_msgs/msg/WrenchStamped, valid:"
        " sensor_msgs/msg/Imu\n"
    )
