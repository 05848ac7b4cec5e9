"""The names of topics and types of ROS 2 on the wire.

https://design.ros2.org/articles/topic_and_service_names.html
"""

from __future__ import annotations

import re

from grasp_factory.errors import UsageError, shown

_PREFIX = "rt"
"""Of topics; services and actions have others."""
_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_TYPE = re.compile(r"([A-Za-z][A-Za-z0-9_]*)::msg::dds_::([A-Za-z][A-Za-z0-9]*)_")
_LONGEST = 240
"""Characters of a topic's name: DDS allows 255, with prefix and room for a namespace."""


def check_topic(name: str) -> None:
    """Check that a name is one that a topic can have.

    Raises:
        UsageError: if it is not.
    """
    if len(name) > _LONGEST or "__" in name or not _TOPIC.fullmatch(name):
        raise UsageError(f"topic {shown(name)}, valid: a name such as /camera/color/image_raw")


def dds_topic(name: str) -> str:
    """Return the name of a topic on the wire."""
    return f"{_PREFIX}{name}"


def ros_topic(name: str) -> str | None:
    """Return the topic that has a name on the wire; None if it is no topic of ROS."""
    inner = name.removeprefix(_PREFIX)
    is_topic = name.startswith(f"{_PREFIX}/") and _TOPIC.fullmatch(inner)
    return inner if is_topic and len(inner) <= _LONGEST else None


def dds_type(kind: str) -> str:
    """Return the name on the wire of a type such as ``sensor_msgs/msg/Imu``."""
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


def ros_type(name: str) -> str | None:
    """Return the type of messages that has a name on the wire; None if ROS has no such type."""
    found = _TYPE.fullmatch(name)
    return f"{found[1]}/msg/{found[2]}" if found else None
