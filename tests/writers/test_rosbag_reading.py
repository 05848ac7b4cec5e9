"""Stores that are made of exported bags again, and bags that are not as they were written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Reader, Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from support import bags
from support.places import TINY

from grasp_factory.curation.restore import restore
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import StoreError
from grasp_factory.writers.exporters.rosbag.bag_files import ros1_types, ros2_types
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker

FORMATS = {
    "rosbag1": ("rosbag1", {}, "000000.bag"),
    "mcap": ("rosbag2", {}, "000000/000000.mcap"),
    "sqlite3": ("rosbag2", {"storage": "sqlite3"}, "000000/000000.db3"),
}


@pytest.fixture(scope="module")
def exports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exports")
    for what, (name, settings, _) in FORMATS.items():
        Dataset(TINY).export(name, folder / what, [0], **settings)
    return folder


@pytest.mark.parametrize("what", FORMATS)
def test_a_store_that_is_made_of_bags_has_every_value_of_the_first_one(
    exports: Path, tmp_path: Path, what: str
) -> None:
    found = restore(exports / what, tmp_path / "store.zarr")
    assert (found.episodes, found.same, found.not_held) == (1, 1, ())


def cut(bag: Path) -> None:
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])


def gone(bag: Path) -> None:
    bag.unlink()


def empty(bag: Path) -> None:
    bag.write_bytes(b"")


def noise(bag: Path) -> None:
    bag.write_bytes(np.random.default_rng(0).bytes(10_000))


def link(bag: Path) -> None:
    bag.rename(bag.parent / "elsewhere")
    bag.symlink_to(bag.parent / "elsewhere")


DAMAGES: dict[Callable[[Path], None], str] = {
    cut: "episode 0 is damaged",
    gone: "episode 0 is damaged",
    empty: "episode 0 is damaged",
    noise: "episode 0 is damaged",
    link: "is a link",
}


@pytest.mark.parametrize("what", FORMATS)
@pytest.mark.parametrize("damage", DAMAGES, ids=lambda damage: damage.__name__)
def test_a_damaged_bag_is_named_in_one_line_and_nothing_is_written(
    exports: Path, tmp_path: Path, what: str, damage: Callable[[Path], None]
) -> None:
    folder = Path(shutil.copytree(exports / what, tmp_path / "bags"))
    damage(folder / FORMATS[what][2])
    check_refused(folder, DAMAGES[damage])


def check_refused(folder: Path, message: str) -> None:
    with pytest.raises(StoreError, match=message) as caught:
        restore(folder, folder.parent / "store.zarr")
    assert "\n" not in str(caught.value)
    assert "/proc/" not in str(caught.value)
    assert not (folder.parent / "store.zarr").exists()


def rewritten(
    bag: Path, change: Callable[[str, str, bytes], tuple[str, str, bytes] | None]
) -> None:
    """Write a bag of ROS 1 again, with a change of each message; None leaves it out."""
    whole, types = bag.with_name("whole"), ros1_types()
    bag.rename(whole)
    with Reader(whole) as reader, Writer(bag) as writer:
        connections = {}
        for connection, stamp, data in reader.messages():
            changed = change(connection.topic, connection.msgtype, data)
            if changed is None:
                continue
            topic, kind, content = changed
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[topic], stamp, content)
    whole.unlink()


def without_joints(topic: str, kind: str, data: bytes) -> tuple[str, str, bytes] | None:
    return None if topic == "/joint_states" else (topic, kind, data)


def strings_as_joints(topic: str, kind: str, data: bytes) -> tuple[str, str, bytes]:
    return (topic, "std_msgs/msg/String" if topic == "/joint_states" else kind, data)


def short_messages(topic: str, kind: str, data: bytes) -> tuple[str, str, bytes]:
    return (topic, kind, data[:-3] if topic == "/imu/data" else data)


def larger_images(topic: str, kind: str, data: bytes) -> tuple[str, str, bytes]:
    if kind != bags.IMAGE:
        return (topic, kind, data)
    message = bags.image(np.zeros((9, 9, 3), np.uint8), "rgb8")
    make = MessageMaker(ros1_types())
    header = make.header(0, "frame")
    return (topic, kind, ros1_types().serialize_ros1(make(kind, header=header, **message), kind))


def fewer_joints(topic: str, kind: str, data: bytes) -> tuple[str, str, bytes]:
    if topic != "/joint_states":
        return (topic, kind, data)
    make = MessageMaker(ros1_types())
    message = make(kind, header=make.header(0, "frame"), position=np.zeros(2))
    return (topic, kind, ros1_types().serialize_ros1(message, kind))


CHANGES: dict[Callable[..., tuple[str, str, bytes] | None], str] = {
    without_joints: r"streams/joint_positions: got float32 \(0, 7\)",
    strings_as_joints: "/joint_states: got 'std_msgs/msg/String'",
    short_messages: "episode 0 is damaged",
    larger_images: r"cameras/front/rgb: got an image \('rgb8', 9, 9\)",
    fewer_joints: "streams/joint_positions: a message has another number of values than 7",
}


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_a_bag_with_other_messages_is_refused(
    exports: Path, tmp_path: Path, change: Callable[..., tuple[str, str, bytes] | None]
) -> None:
    folder = Path(shutil.copytree(exports / "rosbag1", tmp_path / "bags"))
    rewritten(folder / "000000.bag", change)
    check_refused(folder, CHANGES[change])


def test_a_compressed_bag_is_refused_because_it_could_expand(exports: Path, tmp_path: Path) -> None:
    first = Path(shutil.copytree(exports / "rosbag1", tmp_path / "bags1"))
    writer = Writer(tmp_path / "b.bag")
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:
        connection = writer.add_connection("/s", "std_msgs/msg/String", typestore=ros1_types())
        writer.write(connection, 0, bytes(4))
    (tmp_path / "b.bag").replace(first / "000000.bag")
    check_refused(first, "the bag is compressed")
    second = Path(shutil.copytree(exports / "mcap", tmp_path / "bags2"))
    packed = Writer2(tmp_path / "b", version=8, storage_plugin=StoragePlugin.MCAP)
    packed.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with packed:
        kind = "std_msgs/msg/String"
        connection = packed.add_connection("/s", kind, typestore=ros2_types())
        packed.write(connection, 0, bytes(12))
    (tmp_path / "b/b.mcap").replace(second / "000000/000000.mcap")
    check_refused(second, "the bag is compressed")
