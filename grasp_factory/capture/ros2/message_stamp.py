"""The stamp of a message without decoding the rest of it."""

from __future__ import annotations

import struct
from functools import cache

from rosbags.interfaces import Nodetype

from grasp_factory.capture.ros2.message_types import check_type
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types

_HEADER, _TRANSFORMS = "std_msgs/msg/Header", "tf2_msgs/msg/TFMessage"
_ENCODING_BYTES, _LENGTH_BYTES = 4, 4
"""Before the message, and before the transforms of a TFMessage."""
_LITTLE, _BIG = struct.Struct("<iI"), struct.Struct(">iI")
"""Seconds and nanoseconds."""


def stamp_of(kind: str, data: bytes) -> int | None:
    """Return the header's stamp, ns; of transforms, that of the first.

    None if the message has no header, or the stamp 0.

    Args:
        kind: the message's type.
        data: CDR with its header.
    """
    start = _stamp_start(kind)
    if start is None or len(data) < start + _LITTLE.size:
        return None
    seconds, nanoseconds = (_LITTLE if data[1] & 1 else _BIG).unpack_from(data, start)
    return (seconds * 10**9 + nanoseconds) or None


@cache
def _stamp_start(kind: str) -> int | None:
    """Return where the stamp is in messages of a type; None for those without one."""
    check_type(kind)
    if kind == _TRANSFORMS:
        return _ENCODING_BYTES + _LENGTH_BYTES
    _, fields = ros2_types().fielddefs[kind]
    has_header = bool(fields) and fields[0][1] == (Nodetype.NAME, _HEADER)
    return _ENCODING_BYTES if has_header else None
