"""The formats `rosbag1` and `rosbag2`: other readers find in the bags what the store has."""

from __future__ import annotations

import json
import resource
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from peers.flat_messages import flat_arrays
from rosbags.highlevel import AnyReader
from support.bag_contents import check_transforms, equal_episode
from support.fake_episodes import JOINTS, make_episode, small_config
from support.helpers import tree
from support.stored import varied

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.episode import Episode, Streams
from grasp_factory.core.serialization import to_plain
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, StoreError
from grasp_factory.writers.exporters.rosbag.topics import camera_names, joint_names, stamps
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter


def read_mcap(path: Path) -> dict[str, Any]:
    """Return the fields of a bag's messages, read by the library of MCAP's authors."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = reader.iter_decoded_messages()
        return flat_arrays((channel.topic, sent.log_time, m) for _, channel, sent, m in decoded)


def read_bag(path: Path) -> dict[str, Any]:
    """Return the fields of a bag's messages, read by rosbags."""
    with AnyReader([path]) as reader:
        return flat_arrays(
            (connection.topic, stamp, reader.deserialize(data, connection.msgtype))
            for connection, stamp, data in reader.messages()
        )


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Return a store of random episodes: NaN, no grasp, odd names, and one without steps."""
    path = tmp_path_factory.mktemp("source") / "store.zarr"
    names = {name: to_plain(CAMERAS[name].config) for name in ("front", "wrist")}
    config = small_config(video_hz=5, cameras=names, clutter={"count": 2})
    prepare_store(path, config, JOINTS, 4, {})
    episodes = [timed(make_episode(config, k, n_steps)) for k, n_steps in enumerate((9, 2, 4, 0))]
    nowhere = {"grasp_position": np.full(3, np.nan)}
    odd = 'a.b/c "d"\n\U0001f600'
    named = {"object_id": odd, "object_ids": np.array([odd, f"{odd}2"])}
    for k, columns in ((1, nowhere), (2, named)):
        episodes[k] = replace(episodes[k], columns=episodes[k].columns | columns)
    ZarrWriter(path).write_block(0, episodes)
    return Dataset(path)


def timed(episode: Episode) -> Episode:
    """Return an episode with times that ascend."""
    rates = {"imu": episode.spec.imu_hz, "videos": episode.spec.video_hz}
    clocks = {name: at_rate(series, rates[name]) for name, series in episode.own_rate.items()}
    streams = at_rate(episode.streams, episode.spec.record_hz)
    return replace(episode, streams=streams, own_rate=clocks)


def at_rate(series: Streams, rate: int) -> dict[str, Any]:
    return {**series, "timestamp": np.arange(1, len(series["timestamp"]) + 1) / rate}


@pytest.fixture(scope="module")
def simulated(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the bag of an episode."""
    out = tmp_path_factory.mktemp("exports") / "out"
    return dataset.export("rosbag2", out, [0]).path / "000000"


def test_another_library_reads_every_array_of_a_simulated_episode(
    dataset: Dataset, simulated: Path
) -> None:
    episode = dataset[0]
    assert episode.n_steps > 100
    read = read_mcap(simulated / "000000.mcap")
    seen = equal_episode(episode, read)
    check_transforms(episode, read)
    assert seen == sum(
        values.size
        for path, values in episode.contents().items()
        if path not in ("episodes/spec", "episodes/outcome", "episodes/collision_body")
    ) + repeated(episode)


def repeated(episode: Episode) -> int:
    """Return how many intrinsics are compared again: in four messages for each camera."""
    return 3 * 9 * len(episode.cameras)


STORED = {
    "rosbag1": ({}, "{:06d}.bag"),
    "rosbag2 as mcap": ({}, "{:06d}"),
    "rosbag2 as sqlite3": ({"storage": "sqlite3"}, "{:06d}"),
}


@pytest.mark.parametrize("what", STORED)
def test_every_kind_of_bag_holds_every_value_of_any_episode_nan_included(
    fake: Dataset, tmp_path: Path, what: str
) -> None:
    settings, name = STORED[what]
    out = fake.export(what.split(maxsplit=1)[0], tmp_path / "out", **settings).path
    for place, episode in enumerate(fake):
        assert equal_episode(episode, read_bag(out / name.format(place))) > 0


@pytest.fixture
def idle(tmp_path: Path) -> Dataset:
    """Return a store with an episode without an attempt, and cameras with names in many scripts."""
    front = to_plain(CAMERAS["front"].config)
    names = ("caméra", "wrist", "camera_0", "__x", "相机")
    config = small_config(video_hz=5, cameras={name: front for name in names})
    path = tmp_path / "a%41 #b?c.zarr"
    prepare_store(path, config, JOINTS, 1, {})
    ZarrWriter(path).write_block(0, [make_episode(config, 0, n_steps=0)])
    return Dataset(path)


def test_without_an_attempt_there_are_images_label_and_columns(
    idle: Dataset, tmp_path: Path
) -> None:
    out = idle.export("rosbag1", tmp_path / "out").path
    read = read_bag(out / "000000.bag")
    equal_episode(idle[0], read)
    topics = {key.partition("|")[0] for key in read}
    assert not any(
        topic.startswith(("/joint", "/imu/data", "/streams", "/videos")) for topic in topics
    )


def test_cameras_that_ros_cannot_name_get_numbers_and_their_names_are_in_the_episode(
    idle: Dataset, tmp_path: Path
) -> None:
    out = idle.export("rosbag2", tmp_path / "out").path
    read = read_mcap(out / "000000/000000.mcap")
    assert json.loads(str(read["/episode|data"][0]))["cameras"] == {
        "camera_1": "caméra",
        "wrist": "wrist",
        "camera_0": "camera_0",
        "camera_2": "__x",
        "camera_3": "相机",
    }
    topics = {key.split("/")[2] for key in read if key.startswith("/cameras/")}
    assert topics == {"wrist", "camera_0", "camera_1", "camera_2", "camera_3"}


def test_names_of_cameras_stay_different() -> None:
    names = ["é", "camera_0", "è", "a__b", "a_b", "_a", "a_"]
    found = camera_names(names)
    assert len(set(found.values())) == len(names)
    assert found["camera_0"] == "camera_0"
    assert found["a_b"] == "a_b"


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_is_written_to_a_folder_of_any_name(
    fake: Dataset, tmp_path: Path, storage: str
) -> None:
    parent = tmp_path / "a%41 #b?c \U0001f600"
    parent.mkdir()
    fake.export("rosbag2", parent / "o%41#?", [0], storage=storage)
    assert [path.name for path in parent.iterdir()] == ["o%41#?"]
    suffix = {"mcap": "mcap", "sqlite3": "db3"}[storage]
    assert {f"000000/000000.{suffix}", "000000/metadata.yaml"} < set(tree(parent / "o%41#?"))
    assert [path.name for path in tmp_path.iterdir()] == [parent.name]


def test_sqlite_bags_repeat_byte_for_byte_with_any_number_of_workers(
    fake: Dataset, tmp_path: Path
) -> None:
    for name in ("a", "b"):
        fake.export("rosbag2", tmp_path / name, [0, 1], storage="sqlite3", workers=1)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_a_full_disk_under_sqlite_is_one_line_and_leaves_nothing(
    fake: Dataset, tmp_path: Path
) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (64 * 1024, before[1]))
    try:
        with pytest.raises(StoreError, match=r"out cannot be written: SQLite: "):
            fake.export("rosbag2", tmp_path / "out", [0, 1, 2], storage="sqlite3")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_storage_is_refused(fake: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"storage: got 'bag', valid: mcap or sqlite3"):
        fake.export("rosbag2", tmp_path / "out", storage="bag")


def test_the_metadata_is_what_ros_2_humble_reads(simulated: Path) -> None:
    facts = yaml.safe_load((simulated / "metadata.yaml").read_text())
    bag = facts["rosbag2_bagfile_information"]
    assert (bag["version"], bag["storage_identifier"]) == (8, "mcap")
    latched = {
        topic["topic_metadata"]["name"]
        for topic in bag["topics_with_message_count"]
        if "durability: 1" in topic["topic_metadata"]["offered_qos_profiles"]
    }
    assert latched == {"/episode", "/label", "/tf_static", "/imu/T_tcp_imu"}


def test_messages_lie_in_the_order_of_their_stamps(dataset: Dataset, tmp_path: Path) -> None:
    out = dataset.export("rosbag2", tmp_path / "out", [0], storage="sqlite3").path
    with closing(sqlite3.connect(out / "000000/000000.db3")) as file:
        sent = [row[0] for row in file.execute("SELECT timestamp FROM messages ORDER BY id")]
    assert sent == sorted(sent)
    assert sent[0] == 10**9


def test_the_label_is_at_the_grasp_and_without_a_grasp_where_the_target_lay(
    fake: Dataset, tmp_path: Path
) -> None:
    out = fake.export("rosbag1", tmp_path / "out").path
    kinds = set[bool]()
    for place, episode in enumerate(fake):
        read = read_bag(out / f"{place:06d}.bag")
        grasp = np.asarray(episode.columns["grasp_position"])
        has_grasp = bool(np.isfinite(grasp).all())
        wanted = grasp if has_grasp else episode.columns["object_rest_pose"][0, :3]
        found = [read[f"/label|pose.position.{axis}"][0] for axis in "xyz"]
        np.testing.assert_array_equal(found, wanted)
        outcome, object_id = episode.outcome.name.lower(), episode.columns["object_id"]
        assert read["/label|text"][0] == f"{outcome}: {object_id}"
        kinds.add(has_grasp)
    assert kinds == {True, False}


def test_times_that_ros_cannot_hold_become_the_nearest() -> None:
    times = np.array([0.0, np.nan, -5.0, 1e300, 1.0000000004])
    assert stamps(times) == [10**9, 10**9, 0, (2**31 - 1) * 10**9, 2 * 10**9]


@pytest.mark.parametrize("said", [{}, {"robot": 3}, {"robot": {"joint_names": ["a", 3]}}])
def test_joints_have_numbers_where_the_store_does_not_name_them(said: dict[str, Any]) -> None:
    episode = make_episode(small_config(), 0)
    numbered = [f"joint_{k}" for k in range(1, JOINTS + 1)]
    assert joint_names(said, episode) == numbered
    known = [f"j{k}" for k in range(JOINTS)]
    assert joint_names({"robot": {"joint_names": known}}, episode) == known
