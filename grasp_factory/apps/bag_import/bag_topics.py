"""The topics of a bag that are imported, and what each is for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from grasp_factory.apps.bag_import.series_rows import SERIES_KINDS
from grasp_factory.capture.bags.bag_file import raw_messages, reading
from grasp_factory.capture.bags.messages import is_standard, message_of
from grasp_factory.capture.bags.pixel_decoding import (
    DecodedImage,
    decode_compressed_image,
    decode_image,
)
from grasp_factory.errors import UsageError, lookup, shown

_IMAGES = {
    "sensor_msgs/msg/Image": decode_image,
    "sensor_msgs/msg/CompressedImage": decode_compressed_image,
}
_CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
KINDS = (*_IMAGES, _CAMERA_INFO, *SERIES_KINDS)
"""Types of messages that are imported."""
_MOST_TOPICS = 500
"""Each has open files."""
LONGEST_REASON = 300
"""Characters."""
_MOST_REASONS = 5
"""In a message."""


class TopicRole(Enum):
    """What the messages of a topic are."""

    COLOUR = "colour"
    """Colour or grey images."""
    DEPTH = "depth"
    CAMERA_INFO = "camera_info"
    SERIES = "series"


@dataclass(frozen=True, slots=True, kw_only=True)
class BagTopic:
    """A topic to import."""

    name: str
    kind: str
    """Type of its messages, one of ``KINDS``."""
    role: TopicRole
    connections: tuple[Connection, ...]

    def image(self, message: Any) -> DecodedImage:
        """Return the image of a message.

        Raises:
            ValueError: if it cannot be decoded, or is depth where the topic's first image is not.
        """
        image = _IMAGES[self.kind](message)
        if image.is_depth is not (self.role is TopicRole.DEPTH):
            raise ValueError("a depth image and a colour image on one topic")
        return image


def choose_topics(
    bag: Path, reader: AnyReader, names: Sequence[str]
) -> tuple[list[BagTopic], dict[str, str]]:
    """Return the topics to import by name, and for those that are left out the reason.

    Args:
        bag: the bag, for messages.
        reader: its reader.
        names: the topics to import; none for all.

    Raises:
        UsageError: for a name that is unknown, named twice or cannot be imported.
        StoreError: if the bag is damaged.
    """
    found: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        found.setdefault(connection.topic, []).append(connection)
    for k, name in enumerate(names):
        lookup(found, "topic", name)
        if name in names[:k]:
            raise UsageError(f"--topics: {shown(name)} is named twice; name each topic once")
    chosen: list[BagTopic] = []
    left_out: dict[str, str] = {}
    for name in sorted(names or found):
        try:
            chosen.append(_topic(bag, reader, name, found[name]))
        except ValueError as error:
            if names:
                raise UsageError(f"{bag}: the topic {name} cannot be imported: {error}") from None
            left_out[name] = str(error)
    if not chosen:
        why = f" ({reasons(left_out)})" if left_out else ""
        raise UsageError(f"{bag} has no messages to import{why}; valid types: {', '.join(KINDS)}")
    if len(chosen) > _MOST_TOPICS:
        raise UsageError(f"{bag}: got {len(chosen)} topics, valid: up to {_MOST_TOPICS}")
    return chosen, left_out


def reasons(left_out: Mapping[str, str]) -> str:
    """Return why topics are left out, in one line."""
    parts = [f"{name}: {reason}" for name, reason in left_out.items()]
    more = len(parts) - _MOST_REASONS
    return "; ".join([*parts[:_MOST_REASONS], *([f"and {more} more"] if more > 0 else [])])


def _topic(bag: Path, reader: AnyReader, name: str, connections: list[Connection]) -> BagTopic:
    """Return a topic; raise ValueError with the reason if it cannot be imported."""
    kinds = {connection.msgtype for connection in connections}
    kind = min(kinds)
    if len(kinds) > 1:
        raise ValueError(f"it has messages of several types: {', '.join(sorted(kinds))}")
    if kind not in KINDS:
        raise ValueError(f"{kind} has no place in the layout")
    with reading(bag):
        is_the_standard = is_standard(reader, kind)
    if not is_the_standard:
        raise ValueError(f"the bag's definition of {kind} is not that of ROS")
    role = _role(bag, reader, kind, connections)
    return BagTopic(name=name, kind=kind, role=role, connections=tuple(connections))


def _role(bag: Path, reader: AnyReader, kind: str, connections: list[Connection]) -> TopicRole:
    """Return the role by the first message that can be decoded."""
    bad, reason = 0, ""
    for connection, _, data in raw_messages(bag, reader, connections):
        try:
            return _role_of(kind, message_of(reader, connection, data))
        except ValueError as error:
            bad, reason = bad + 1, reason or str(error)[:LONGEST_REASON]
    if not bad:
        raise ValueError("it has no messages")
    raise ValueError(f"none of its {bad} messages can be decoded, the first because {reason}")


def _role_of(kind: str, message: Any) -> TopicRole:
    if kind == _CAMERA_INFO:
        return TopicRole.CAMERA_INFO
    if kind not in _IMAGES:
        return TopicRole.SERIES
    return TopicRole.DEPTH if _IMAGES[kind](message).is_depth else TopicRole.COLOUR
