"""The formats ``rosbag1`` and ``rosbag2``: a bag for each episode, with all of its arrays."""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from grasp_factory.core.serialization import check
from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    ExportContents,
    Exporter,
    ExportFolder,
    ExportJob,
    ExportPart,
)

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from grasp_factory.writers.exporters.rosbag.topics import StampedMessage

STORAGES = ("mcap", "sqlite3")


@dataclass(frozen=True, slots=True, kw_only=True)
class Rosbag2Settings:
    """Settings of ``rosbag2``."""

    storage: str = "mcap"
    """Format of the file in a bag's folder: mcap, the default since ROS 2 Iron, or sqlite3."""

    def __post_init__(self) -> None:
        check(self.storage in STORAGES, "storage", self.storage, " or ".join(STORAGES))


def write_ros1_part(job: ExportJob, part: ExportPart) -> None:
    """Write a file for each episode."""
    from grasp_factory.writers.exporters.rosbag.bag_files import ros1_types, write_ros1_bag

    for place, messages in _bags(job, part, ros1_types()):
        write_ros1_bag(job.folder / f"{place:06d}.bag", messages)


def write_ros2_part(job: ExportJob, part: ExportPart) -> None:
    """Write a folder for each episode."""
    from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types, write_ros2_bag

    for place, messages in _bags(job, part, ros2_types()):
        write_ros2_bag(job.folder / f"{place:06d}", job.settings.storage, messages)


def _bags(
    job: ExportJob, part: ExportPart, types: Typestore
) -> Iterator[tuple[int, Iterator[StampedMessage]]]:
    """Yield number and messages of each episode."""
    from grasp_factory.writers.exporters.rosbag.episode_messages import episode_messages
    from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker
    from grasp_factory.writers.exporters.rosbag.topics import scene_of

    make = MessageMaker(types)
    for place, episode in part.episodes:
        yield place, episode_messages(scene_of(job.episodes, place, episode, make))


def read_ros1_back(folder: ExportFolder, place: int) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of an episode by path; see ``Exporter.read_back``."""
    from grasp_factory.writers.exporters.rosbag.bag_reading import read_back_ros1

    return read_back_ros1(folder, place)


def read_ros2_back(folder: ExportFolder, place: int) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of an episode by path; see ``Exporter.read_back``."""
    from grasp_factory.writers.exporters.rosbag.bag_reading import read_back_ros2

    return read_back_ros2(folder, place)


_CONTENTS = ExportContents(
    written=("*",),
    treatment={
        "time": "a stamp is 1 s plus the time since the start, rounded to 1 ns; the exact times are"
        " in /streams/timestamp, /imu/timestamp and /videos/timestamp",
        REAL_ROWS: "devices have each sample at its own time, and its exact time in the topic"
        " timestamp of each group; poses that were not measured are not in /tf and /tf_static, and"
        " null in the JSON of /episode",
        "NaN": "kept in messages, null in the JSON of /episode",
        "no grasp": "/label is where the target lay, or at the origin",
        "no attempt": "the images after have the stamp of those before, and there is no series",
        "no video": "there are no topics of the videos",
        "standard messages": "float32 becomes float64, which holds the same value; what fits none"
        " is an array of std_msgs with named dimensions",
        "names": "a camera that ROS cannot name is camera_0, camera_1, ...: /episode says which",
        "tf": "world to tcp and objects; cameras, imu and ft_sensor are in /tf_static; left_pad and"
        " right_pad have none: the distance between them is in /gripper/state",
        "compression": "none; use `rosbag compress` or `ros2 bag convert`",
    },
)
ROSBAG1 = Exporter(
    name="rosbag1",
    description="ROS 1 bags, one file per episode: images, joints, IMU, wrenches, tf, label",
    contents=_CONTENTS,
    write_part=write_ros1_part,
    read_back=read_ros1_back,
    libraries=("rosbags",),
    extra="ros",
)
ROSBAG2 = Exporter(
    name="rosbag2",
    description="ROS 2 bags, one folder per episode: images, joints, IMU, wrenches, tf, label",
    contents=_CONTENTS,
    write_part=write_ros2_part,
    read_back=read_ros2_back,
    parameters=Rosbag2Settings,
    libraries=("rosbags",),
    extra="ros",
)
