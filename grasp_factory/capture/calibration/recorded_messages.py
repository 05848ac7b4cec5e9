"""Messages of one topic of a session or a bag. Call it in a process with limits."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from grasp_factory.core.regular_file import open_regular
from grasp_factory.errors import CaptureError, GraspFactoryError, UsageError

SESSION_FILE = "session.mcap"
BAG_SUFFIXES = (".mcap", ".bag")


def message_file(source: Path) -> Path | None:
    """Return the file with the messages of a session folder or a bag; None for something else."""
    if source.suffix in BAG_SUFFIXES:
        return source
    return source / SESSION_FILE if os.path.lexists(source / SESSION_FILE) else None


def messages_of(file: Path, kinds: tuple[str, ...], topic: str) -> Iterator[tuple[float, Any]]:
    """Yield time (s, of the header, or of the arrival without one) and message.

    Args:
        file: an MCAP file, or a bag of ROS 1.
        kinds: types of messages, such as ``sensor_msgs/msg/Imu``.
        topic: its name; empty if the file has one topic of these types.

    Raises:
        UsageError: if the file cannot be opened, or for an unknown topic, or several.
        CaptureError: if it is damaged.
    """
    try:
        os.close(open_regular(file, os.O_RDONLY))
    except OSError as error:
        raise UsageError(f"{file} cannot be read: {error.strerror or error}") from None
    with _explained(file):
        humble = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([file], default_typestore=humble) as reader:
            found = [c for c in reader.connections if c.msgtype in kinds]
            name = _topic(file, {c.topic for c in found}, kinds, topic)
            chosen = [c for c in found if c.topic == name]
            for kind in {c.msgtype for c in chosen}:
                _check_standard(file, reader, kind)
            for connection, arrival, data in reader.messages(connections=chosen):
                message: Any = reader.deserialize(data, connection.msgtype)
                stamp = message.header.stamp
                time = stamp.sec + stamp.nanosec * 1e-9
                yield (time if time > 0.0 else arrival * 1e-9), message


def _check_standard(file: Path, reader: AnyReader, kind: str) -> None:
    """Check that the file means by a type of messages what ROS means by it."""
    if reader.is2:
        humble = get_typestore(Stores.ROS2_HUMBLE)
        is_same = reader.typestore.hash_rihs01(kind) == humble.hash_rihs01(kind)
    else:
        noetic = get_typestore(Stores.ROS1_NOETIC)
        is_same = reader.typestore.generate_msgdef(kind)[1] == noetic.generate_msgdef(kind)[1]
    if not is_same:
        raise CaptureError(f"{file}: its definition of {kind} is not that of ROS")


def _topic(file: Path, names: set[str], kinds: tuple[str, ...], topic: str) -> str:
    listed = ", ".join(sorted(names)) or "none"
    if topic and topic not in names:
        raise UsageError(f"{file}: no topic {topic} of {', '.join(kinds)}; it has: {listed}")
    if not topic and len(names) != 1:
        raise UsageError(f"{file}: topics of {', '.join(kinds)}: {listed}; choose one with --topic")
    return topic or names.pop()


@contextlib.contextmanager
def _explained(file: Path) -> Iterator[None]:
    """Turn whatever the library raises at a damaged file into one error."""
    try:
        yield
    except (MemoryError, GraspFactoryError, GeneratorExit):
        raise
    except Exception as error:
        text = " ".join(str(error).split())[:300]
        raise CaptureError(f"{file} cannot be read: {type(error).__name__}: {text}") from None
