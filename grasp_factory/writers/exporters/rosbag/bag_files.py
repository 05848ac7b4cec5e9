"""Bags of ROS 1 and ROS 2 as files, written by rosbags.

https://ternaris.gitlab.io/rosbags/
"""

from __future__ import annotations

import contextlib
import errno
import sqlite3
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Literal
from urllib.parse import quote

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from grasp_factory.writers.exporters.rosbag.topics import StampedMessage

_METADATA_VERSION: Literal[8] = 8
"""Of metadata.yaml. The readers of ROS 2 Humble do not know version 9."""
_TF = "geometry_msgs/TransformStamped[] transforms"
"""tf2_msgs/TFMessage, https://docs.ros.org/en/noetic/api/tf2_msgs/html/msg/TFMessage.html"""
_INFINITE = QosTime(9223372036, 854775807)
"""RMW_DURATION_INFINITE, https://github.com/ros2/rmw/blob/humble/rmw/include/rmw/time.h"""
_LATCHED = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=_INFINITE,
    lifespan=_INFINITE,
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=_INFINITE,
    avoid_ros_namespace_conventions=False,
)
"""Of a topic such as ``/tf_static``, whose last message later subscribers get, too."""


@cache
def ros1_types() -> Typestore:
    """Return the messages of ROS 1 Noetic."""
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_TF, "tf2_msgs/msg/TFMessage"))
    return store


@cache
def ros2_types() -> Typestore:
    """Return the messages of ROS 2 Humble."""
    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def _ros1_definition(kind: str) -> tuple[str, str]:
    """Return definition and MD5 of a type of ROS 1."""
    return ros1_types().generate_msgdef(kind)


@cache
def ros2_definition(kind: str) -> tuple[str, str]:
    """Return definition and hash of a type of ROS 2."""
    definition, _ = ros2_types().generate_msgdef(kind, ros_version=2)
    return definition, ros2_types().hash_rihs01(kind)


def write_ros1_bag(path: Path, messages: Iterable[StampedMessage]) -> None:
    """Write a bag of ROS 1, which is one file, without compression.

    Raises:
        OSError: if it cannot be written.
    """
    types, connections = ros1_types(), dict[str, Connection]()
    with contextlib.ExitStack() as stack:
        writer = Writer1(path)
        stack.callback(writer.abort)  # closes the file if opening it fails half way
        stack.enter_context(writer)
        for stamp, topic, message in messages:
            if topic.name not in connections:
                definition, md5 = _ros1_definition(topic.kind)
                connections[topic.name] = writer.add_connection(
                    topic.name,
                    topic.kind,
                    msgdef=definition,
                    md5sum=md5,
                    latching=int(topic.is_latched),
                )
            data = types.serialize_ros1(message, topic.kind)
            writer.write(connections[topic.name], stamp, data)


def write_ros2_bag(path: Path, storage: str, messages: Iterable[StampedMessage]) -> None:
    """Write a bag of ROS 2, which is a folder, without compression.

    Args:
        path: the folder to create.
        storage: mcap or sqlite3.
        messages: in the order of their stamps.

    Raises:
        OSError: if it cannot be written.
    """
    types, connections = ros2_types(), dict[str, Connection]()
    plugin = StoragePlugin[storage.upper()]
    try:
        with _Ros2Writer(path, version=_METADATA_VERSION, storage_plugin=plugin) as writer:
            for stamp, topic, message in messages:
                if topic.name not in connections:
                    definition, rihs01 = ros2_definition(topic.kind)
                    connections[topic.name] = writer.add_connection(
                        topic.name,
                        topic.kind,
                        msgdef=definition,
                        rihs01=rihs01,
                        offered_qos_profiles=[_LATCHED] if topic.is_latched else [],
                    )
                data = types.serialize_cdr(message, topic.kind, little_endian=True)
                writer.write(connections[topic.name], stamp, data)
    except sqlite3.Error as error:
        raise OSError(errno.EIO, f"SQLite: {error}") from None


class _McapFileWriter(McapWriter):
    """Closes the file if it cannot write the first bytes."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        try:
            super().__init__(path, compression)
        except OSError:
            if hasattr(self, "bio"):
                self.bio.close()
            raise


class _QuotedSqlite3Writer(Sqlite3Writer):
    """Writes to any folder: rosbags makes a URI from the path and does not quote it."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(Path(quote(str(path))), compression)


class _Ros2Writer(Writer2):
    STORAGE_PLUGINS = MappingProxyType(
        {StoragePlugin.MCAP: _McapFileWriter, StoragePlugin.SQLITE3: _QuotedSqlite3Writer}
    )
