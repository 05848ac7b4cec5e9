"""Subscribers to topics: messages as bytes, with the instant at which they arrived."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from grasp_factory.capture.ros2.dds_names import check_topic, dds_topic
from grasp_factory.capture.ros2.message_types import sample_type_of
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.quality_of_service import TopicQuality

_AT_ONCE = 64
"""Messages that are taken from a topic in one call."""
_ANY = ViewState.Any | InstanceState.Any | SampleState.Any


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedMessage:
    """A message as it came."""

    topic: str
    kind: str
    """Its type."""
    data: bytes
    """CDR with its header."""
    source_ns: int
    """When its publisher sent it, by the publisher's clock, ns since the epoch."""
    host_ns: int
    """``time.monotonic_ns()`` when it was taken."""


class TopicSubscriber:
    """Takes the messages of one topic.

    Attributes:
        name: the topic.
        kind: the type of its messages.
    """

    def __init__(
        self, participant: Participant, name: str, kind: str, quality: TopicQuality
    ) -> None:
        """Subscribe.

        Args:
            participant: the member of a domain that it belongs to.
            name: the topic, such as ``/imu/data``.
            kind: the type of its messages, such as ``sensor_msgs/msg/Imu``.
            quality: its quality of service; one that is reliable hears no best-effort publisher.

        Raises:
            UsageError: for a name or a type that ROS does not have.
        """
        check_topic(name)
        self._participant = participant  # its domain ends when nothing refers to it
        self.name, self.kind = name, kind
        topic = Topic(participant.dds, dds_topic(name), sample_type_of(kind))
        self._reader = DataReader(participant.dds, topic, quality.policies())
        self.condition = ReadCondition(self._reader, _ANY)

    @property
    def publishers(self) -> int:
        """How many there are now."""
        return int(self._reader.get_subscription_matched_status().current_count)

    def take(self) -> list[ReceivedMessage]:
        """Return messages that have arrived, oldest first."""
        samples = self._reader.take(N=_AT_ONCE)
        now = time.monotonic_ns()
        return [
            ReceivedMessage(
                topic=self.name,
                kind=self.kind,
                data=sample.cdr,
                source_ns=sample.sample_info.source_timestamp,
                host_ns=now,
            )
            for sample in samples
            if sample.sample_info.valid_data
        ]


class Inbox:
    """The messages of several subscribers."""

    def __init__(self, participant: Participant, subscribers: Sequence[TopicSubscriber]) -> None:
        """Watch subscribers of a participant."""
        self._participant, self._subscribers = participant, subscribers
        self._waiting = WaitSet(participant.dds)
        for subscriber in subscribers:
            self._waiting.attach(subscriber.condition)

    def take(self, timeout_s: float) -> list[ReceivedMessage]:
        """Return messages, those of a topic oldest first; none if none came in time."""
        if not self._waiting.wait(duration(seconds=timeout_s)):
            return []
        found: list[ReceivedMessage] = []
        for subscriber in self._subscribers:
            found += subscriber.take()
        return found
