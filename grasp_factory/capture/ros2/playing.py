"""Playing messages as topics: announce them, wait for subscribers, send each when it is due."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from grasp_factory.capture.ros2.clock_topic import CLOCK, ClockTicks, clock_message
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.play_clock import PlayClock, PlayRate
from grasp_factory.capture.ros2.publisher import TopicPublisher
from grasp_factory.capture.ros2.quality_of_service import Reliability, TopicQuality
from grasp_factory.core.serialization import check_range, normalise
from grasp_factory.core.text_format import count
from grasp_factory.errors import CaptureError, UsageError
from grasp_factory.writers.exporters.rosbag.topics import Topic

_POLL_S = 0.02
_SETTLE_S = 0.5
"""Between the last match and the first message: each side hears of the other by itself."""
_ACKNOWLEDGE_S = 10.0


class PlayedMessage(NamedTuple):
    """A message that is to be sent."""

    stamp_ns: int
    """When, on the recording's own clock."""
    topic: str
    data: bytes
    """CDR with its header."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaySettings:
    """How a recording is played."""

    rate: PlayRate = field(default_factory=PlayRate)
    reliability: Reliability = Reliability.RELIABLE
    depth: int = 0
    """See ``TopicQuality.depth``."""
    match_s: float = 10.0
    """How long to wait for subscribers, seconds."""
    waits_for_all: bool = False
    """Whether every topic needs a subscriber, and not just one of them."""
    with_clock: bool = False
    """Whether the recording's own time is sent too, on ``/clock``."""

    def __post_init__(self) -> None:
        normalise(self)
        check_range(self, "match_s", 0.0, 86400.0, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class Played:
    """What was sent."""

    sent: Mapping[str, int]
    """Messages by topic."""
    subscribed: int
    """Topics that had a subscriber at the end."""
    duration_s: float
    latest_s: float
    """How late the latest message was sent, seconds."""


class TopicPlayer:
    """Publishes the messages of recordings. One thread uses it."""

    def __init__(self, participant: Participant, settings: PlaySettings) -> None:
        """Prepare; ``announce`` comes next."""
        self._participant, self._settings = participant, settings
        self._publishers: dict[str, TopicPublisher] = {}
        self.begin()

    def announce(self, topics: Sequence[Topic]) -> None:
        """Announce topics; those that are announced already stay.

        Raises:
            UsageError: for a name or a type that ROS 2 does not have, or if the recording has a
                ``/clock`` of its own beside ours.
        """
        if self._settings.with_clock:
            if CLOCK.name in {topic.name for topic in topics}:
                raise UsageError(
                    f"--clock: the recording has a topic {CLOCK.name}; leave --clock out, or"
                    f" rename the topic with --remap {CLOCK.name}:=/recorded_clock"
                )
            topics = (*topics, CLOCK)
        for topic in topics:
            if topic.name not in self._publishers:
                quality = TopicQuality(
                    reliability=self._settings.reliability,
                    depth=self._settings.depth,
                    is_latched=topic.is_latched,
                )
                self._publishers[topic.name] = TopicPublisher(
                    self._participant, topic.name, topic.kind, quality
                )

    def wait_for_subscribers(self) -> None:
        """Wait until there are subscribers, and no more come.

        Raises:
            CaptureError: if there are none in time.
        """
        settings = self._settings
        end = time.monotonic() + settings.match_s
        settled, before = time.monotonic(), -1
        while True:
            now = time.monotonic()
            without = [name for name, each in self._publishers.items() if not each.subscribers]
            if len(without) != before:
                settled, before = now + _SETTLE_S, len(without)
            needed = 0 if settings.waits_for_all else len(self._publishers) - 1
            if len(without) <= needed and now >= settled:
                return
            if len(without) > needed and now >= end:
                raise CaptureError(self._complaint(without))
            time.sleep(_POLL_S)

    def play(self, messages: Iterable[PlayedMessage], on_message: Callable[[], None]) -> Played:
        """Send messages when they are due, and wait until subscribers have them.

        Args:
            messages: in the order of their stamps.
            on_message: called after each.

        Raises:
            CaptureError: if a subscriber takes no messages any more.
        """
        self.begin()
        for message in messages:
            self.send(message)
            on_message()
        return self.finish()

    def begin(self) -> None:
        """Begin with a recording: its first message is due at once."""
        self._start, self._clock = time.monotonic(), PlayClock(self._settings.rate)
        self._ticks = ClockTicks(skips_pauses=self._settings.rate.factor is None)
        self._before = {name: each.sent for name, each in self._publishers.items()}

    def send(self, message: PlayedMessage) -> None:
        """Send a message when it is due, and before it the times that are due.

        Raises:
            CaptureError: if a subscriber takes no messages any more.
        """
        if self._settings.with_clock:
            for stamp in self._ticks.until(message.stamp_ns):
                self._clock.wait(stamp)
                self._publishers[CLOCK.name].send(clock_message(stamp))
        self._clock.wait(message.stamp_ns)
        self._publishers[message.topic].send(message.data)

    def finish(self) -> Played:
        """Wait until subscribers have all messages; return what was sent since ``begin``.

        Raises:
            CaptureError: if a subscriber does not confirm them.
        """
        self._wait_until_received()
        return Played(
            sent={name: each.sent - self._before[name] for name, each in self._publishers.items()},
            subscribed=sum(each.subscribers > 0 for each in self._publishers.values()),
            duration_s=time.monotonic() - self._start,
            latest_s=self._clock.latest_s,
        )

    def _wait_until_received(self) -> None:
        end = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in self._publishers.values():
            if not publisher.wait_until_received(max(0.0, end - time.monotonic())):
                raise CaptureError(
                    f"{publisher.name}: a subscriber did not confirm the last messages within"
                    f" {_ACKNOWLEDGE_S:g} s, so some may be lost"
                )

    def _complaint(self, without: Sequence[str]) -> str:
        network, settings = self._participant.network, self._settings
        where = f"domain {network.domain_id}, interface {network.interface}"
        if len(without) == len(self._publishers):
            what = f"nobody subscribes to any of {count(len(without), 'topic')}"
        else:
            what = f"nobody subscribes to {', '.join(without)}"
        return (
            f"{what} within {settings.match_s:g} s ({where}): start the subscriber first, and check"
            " its ROS_DOMAIN_ID"
        )
