"""What is in a bag: its topics with type, number of messages, rate and longest gap."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from grasp_factory.capture.bags.bag_file import raw_messages

_NS = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicFacts:
    """A topic of a bag; its times are those at which messages arrived at the recorder."""

    name: str
    kind: str
    """Type of its messages; several are joined by a comma."""
    count: int
    rate_hz: float | None
    """Messages per second from the first to the last; None for less than two instants."""
    longest_gap_s: float | None
    """Longest time between two messages that follow each other; None for less than two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BagFacts:
    """What is in a bag."""

    topics: tuple[TopicFacts, ...]
    """By name."""
    without_topic: int
    """Messages that belong to none of the topics: they cannot be read."""


@dataclass(slots=True)
class _Clock:
    """The arrivals of a topic's messages so far, ns."""

    count: int = 0
    first: int = 0
    last: int = 0
    gap: int = 0

    def add(self, time: int) -> None:
        self.first = time if self.count == 0 else self.first
        self.gap = max(self.gap, time - self.last) if self.count else 0
        self.count, self.last = self.count + 1, time


def facts_of(bag: Path, reader: AnyReader) -> BagFacts:
    """Return what is in a bag; all of it is read.

    Raises:
        StoreError: if it is damaged.
    """
    kinds: dict[str, set[str]] = {}
    for connection in reader.connections:
        kinds.setdefault(connection.topic, set()).add(connection.msgtype)
    clocks = {name: _Clock() for name in kinds}
    for connection, time, _ in raw_messages(bag, reader, reader.connections):
        clocks[connection.topic].add(time)
    return BagFacts(
        topics=tuple(
            _facts(name, ", ".join(sorted(kinds[name])), clocks[name]) for name in sorted(kinds)
        ),
        without_topic=without_topic(reader),
    )


def without_topic(reader: AnyReader) -> int:
    """Return how many messages of a bag belong to none of its topics.

    In a database the row of their topic is missing, or the metadata.yaml of the folder does not
    name the topic. rosbags passes over them.
    """
    known = {repr(_identity(connection)) for connection in reader.connections}
    lost = 0
    for part in reader.readers:
        storage: Any = getattr(part, "storage", None)  # a bag of ROS 1 has none
        for file in getattr(storage, "storages", [storage] if storage else []):
            lost += sum(
                each.msgcount for each in file.connections if repr(_identity(each)) not in known
            )
            if isinstance(file, Sqlite3Reader):
                lost += file.metadata.message_count
                lost -= sum(each.msgcount for each in file.connections)
    return lost


def _identity(connection: Connection) -> tuple[Any, ...]:
    """Return what rosbags finds the topic of a folder's metadata in one of its files by."""
    return connection.topic, connection.msgtype, connection.ext


def _facts(name: str, kind: str, clock: _Clock) -> TopicFacts:
    duration = (clock.last - clock.first) * _NS
    return TopicFacts(
        name=name,
        kind=kind,
        count=clock.count,
        rate_hz=(clock.count - 1) / duration if duration > 0 else None,
        longest_gap_s=clock.gap * _NS if clock.count > 1 else None,
    )
