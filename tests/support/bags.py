"""Bags of chosen messages, written by rosbags."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.writers.exporters.rosbag.bag_files import (
    ros1_types,
    ros2_types,
    write_ros1_bag,
    write_ros2_bag,
)
from grasp_factory.writers.exporters.rosbag.message_maker import MessageMaker
from grasp_factory.writers.exporters.rosbag.topics import StampedMessage, Topic

Content = tuple[str, str, int, dict[str, Any]]
"""Topic, type, time of arrival (ns), and fields in lower case; ``stamp`` is that of the header."""

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, IMU = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/Imu"
ODOMETRY, JOINTS = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"


def ros1(path: Path, contents: Iterable[Content]) -> Path:
    """Write a bag of ROS 1."""
    write_ros1_bag(path, messages(MessageMaker(ros1_types()), contents))
    return path


def mcap(path: Path, contents: Iterable[Content]) -> Path:
    """Write a folder with an MCAP file."""
    write_ros2_bag(path, "mcap", messages(MessageMaker(ros2_types()), contents))
    return path


def sqlite3(path: Path, contents: Iterable[Content]) -> Path:
    """Write a folder with a db3 file."""
    write_ros2_bag(path, "sqlite3", messages(MessageMaker(ros2_types()), contents))
    return path


WRITERS: dict[str, Callable[[Path, Iterable[Content]], Path]] = {
    "b.bag": ros1,
    "b_mcap": mcap,
    "b_sqlite3": sqlite3,
}


def messages(make: MessageMaker, contents: Iterable[Content]) -> Iterable[StampedMessage]:
    for name, kind, arrival, fields in contents:
        stamp = fields.get("stamp", arrival)
        more = {key: value for key, value in fields.items() if key != "stamp"}
        if callable(more.get("of")):
            more = more.pop("of")(make) | more
        if kind.partition("/")[0] != "std_msgs":
            more["header"] = make.header(stamp, "frame")
        yield StampedMessage(arrival, Topic(name=name, kind=kind), make(kind, **more))


def image(
    values: NDArray[Any], encoding: str, *, padding: int = 0, big: bool = False
) -> dict[str, Any]:
    """Return the fields of an image (H, W) or (H, W, channels), whose rows may be padded."""
    stored = values.astype(values.dtype.newbyteorder(">" if big else "<"))
    rows = np.ascontiguousarray(stored).reshape(len(values), -1).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=7)
    return {
        "height": values.shape[0],
        "width": values.shape[1],
        "encoding": encoding,
        "is_bigendian": int(big),
        "step": padded.shape[1],
        "data": padded.ravel(),
    }


def imu(force: Iterable[float], angular: Iterable[float], **more: Any) -> dict[str, Any]:
    """Return the fields of an IMU's message."""
    return {
        "of": lambda make: {
            "linear_acceleration": make.vector(list(force)),
            "angular_velocity": make.vector(list(angular)),
        }
    } | more


def odometry(position: Iterable[float], quat_xyzw: Iterable[float]) -> dict[str, Any]:
    """Return the fields of an odometry's message."""
    return {
        "of": lambda make: {
            "pose": make(
                "geometry_msgs/msg/PoseWithCovariance", pose=make.pose([*position, *quat_xyzw])
            )
        }
    }


def wrench(force: Iterable[float], torque: Iterable[float]) -> dict[str, Any]:
    """Return the fields of a wrench's message."""
    return {
        "of": lambda make: {
            "wrench": make(
                "geometry_msgs/msg/Wrench",
                force=make.vector(list(force)),
                torque=make.vector(list(torque)),
            )
        }
    }


def end_the_process(job: Any, report: Any) -> None:
    """Be a task whose process is killed, as by a crash of a decoder."""
    os.kill(os.getpid(), signal.SIGKILL)
