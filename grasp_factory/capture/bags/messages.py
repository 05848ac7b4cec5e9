"""Messages of a bag: decoded, their stamps, and whether their type is what ROS means by it."""

from __future__ import annotations

from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_typestore

from grasp_factory.errors import GraspFactoryError


def message_of(reader: AnyReader, connection: Connection, data: bytes) -> Any:
    """Return a message.

    Raises:
        ValueError: if its bytes do not fit its type.
    """
    try:
        return reader.deserialize(data, connection.msgtype)
    except (MemoryError, GraspFactoryError):
        raise
    except Exception as error:
        raise ValueError(f"the bytes are no {connection.msgtype}: {error}") from None


def is_standard(reader: AnyReader, kind: str) -> bool:
    """Return whether the bag means by a type of messages what ROS means by it."""
    if reader.is2:
        humble = get_typestore(Stores.ROS2_HUMBLE)
        return reader.typestore.hash_rihs01(kind) == humble.hash_rihs01(kind)
    _, md5 = reader.typestore.generate_msgdef(kind)
    _, standard = get_typestore(Stores.ROS1_NOETIC).generate_msgdef(kind)
    return md5 == standard


def stamp_ns_of(message: Any) -> int | None:
    """Return the stamp of a message's header; None if the header has no stamp."""
    stamp = message.header.stamp
    found = int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return found if found > 0 else None
