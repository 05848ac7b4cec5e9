"""A diagnosis of topics: types, publishers, and how fast messages come."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from grasp_factory.capture.ros2.discovery import PublishedTopic, TopicWatch
from grasp_factory.capture.ros2.message_types import knows_type
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.subscriber import Inbox, TopicSubscriber

_POLL_S = 0.1
_NS = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class TopicReport:
    """A topic and how its messages came."""

    name: str
    kinds: tuple[str, ...]
    publishers: int
    reliability: str
    is_latched: bool
    count: int
    """Messages that came while it was watched."""
    rate_hz: float | None
    """By arrival; None for fewer than two messages."""
    longest_gap_s: float | None
    """Between two arrivals."""
    bytes_per_s: float
    can_be_collected: bool
    """Whether ROS 2 Humble has the type, and publishers do not contradict each other."""


def report_topics(
    participant: Participant, names: Sequence[str], wait_s: float, seconds: float
) -> list[TopicReport]:
    """Return the topics that are published.

    Args:
        participant: a member of their domain.
        names: the topics; none for all.
        wait_s: how long to wait for the topics, or without names to look for any.
        seconds: how long to watch their messages.

    Raises:
        CaptureError: if a named topic is not published in time.
    """
    found = find_topics(participant, names, wait_s)
    subscribers = [
        TopicSubscriber(participant, name, topic.kinds[0], topic.quality(0))
        for name, topic in found.items()
        if can_be_collected(topic)
    ]
    arrivals: dict[str, list[int]] = {name: [] for name in found}
    sizes = dict.fromkeys(found, 0)
    inbox, start = Inbox(participant, subscribers), time.monotonic()
    while (left := start + seconds - time.monotonic()) > 0:
        for message in inbox.take(min(_POLL_S, left)):
            arrivals[message.topic].append(message.source_ns)
            sizes[message.topic] += len(message.data)
    return [_report(topic, arrivals[name], sizes[name] / seconds) for name, topic in found.items()]


def find_topics(
    participant: Participant, names: Sequence[str], wait_s: float
) -> dict[str, PublishedTopic]:
    """Return the named topics as soon as they are published; without names those found in time.

    Raises:
        CaptureError: if a named topic is not published in time.
    """
    watch = TopicWatch(participant)
    if names:
        return watch.wait_for(names, wait_s)
    time.sleep(wait_s)
    return watch.topics()


def can_be_collected(topic: PublishedTopic) -> bool:
    """Return whether the messages of a topic can be written."""
    return len(topic.kinds) == 1 and knows_type(topic.kinds[0])


def _report(topic: PublishedTopic, times: Sequence[int], bytes_per_s: float) -> TopicReport:
    steps = [b - a for a, b in pairwise(times)]
    span = times[-1] - times[0] if steps else 0
    return TopicReport(
        name=topic.name,
        kinds=topic.kinds,
        publishers=topic.publishers,
        reliability="reliable" if topic.is_reliable else "best-effort",
        is_latched=topic.is_latched,
        count=len(times),
        rate_hz=len(steps) / (span * _NS) if span > 0 else None,
        longest_gap_s=max(steps) * _NS if steps else None,
        bytes_per_s=bytes_per_s,
        can_be_collected=can_be_collected(topic),
    )
