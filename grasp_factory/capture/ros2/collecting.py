"""Collecting topics into a file: one thread takes messages, another one writes them."""

from __future__ import annotations

import math
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.capture.ros2.discovery import PublishedTopic
from grasp_factory.capture.ros2.message_stamp import stamp_of
from grasp_factory.capture.ros2.network import Participant
from grasp_factory.capture.ros2.stream_gaps import StreamGaps
from grasp_factory.capture.ros2.subscriber import Inbox, ReceivedMessage, TopicSubscriber
from grasp_factory.capture.ros2.topic_file import TopicFile
from grasp_factory.core.serialization import check_range, normalise

_POLL_S = 0.1
_NS = 1e-9
QUEUE_BYTES = 256 * 2**20
"""Messages that wait for the disk; more are dropped, and counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectSettings:
    """When collecting ends; without either, when it is interrupted."""

    seconds: float | None = None
    """Length."""
    silence_s: float | None = None
    """Ends so long after the last message, once there was one."""
    depth: int = 0
    """See ``TopicQuality.depth``."""

    def __post_init__(self) -> None:
        normalise(self)
        for key in ("seconds", "silence_s"):
            if getattr(self, key) is not None:
                check_range(self, key, 0.01, 30 * 86400.0, "s")


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectedTopic:
    """What came on a topic."""

    name: str
    kind: str
    """Type of its messages."""
    count: int
    missing: int | None
    """Messages that the stamps say are missing, if the topic has a steady rate; None if its
    messages have no stamps."""
    dropped: int
    """Messages that came and were not written, because the disk was too slow."""
    rate_hz: float | None
    """By the stamps, without them by when messages were sent; None for fewer than two messages."""
    longest_gap_s: float
    backward: int
    """Stamps, or instants of sending, that are not later than the one before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Collection:
    """What was collected."""

    path: Path
    bytes: int
    duration_s: float
    topics: tuple[CollectedTopic, ...]


class TopicCollector:
    """Subscribes to topics and writes what comes to a file."""

    def __init__(
        self,
        participant: Participant,
        topics: Mapping[str, PublishedTopic],
        path: Path,
        settings: CollectSettings,
    ) -> None:
        """Subscribe, and create the file.

        Raises:
            UsageError: if the file cannot be created, or ROS 2 Humble has no such type.
        """
        subscribers = [
            TopicSubscriber(participant, name, found.kinds[0], found.quality(settings.depth))
            for name, found in topics.items()
        ]
        self._kinds = {each.name: each.kind for each in subscribers}
        self._gaps = {name: StreamGaps() for name in self._kinds}
        self._dropped = dict.fromkeys(self._kinds, 0)
        self._unstamped = set[str]()
        self._settings, self._path = settings, path
        self._file = TopicFile(path)
        self._inbox = Inbox(participant, subscribers)
        self._epoch_ns = time.time_ns() - time.monotonic_ns()
        self._queue: queue.SimpleQueue[ReceivedMessage | None] = queue.SimpleQueue()
        self._taken = self._written = 0
        self._error: Exception | None = None

    def collect(self, on_message: Callable[[], None], is_stopped: threading.Event) -> Collection:
        """Collect until the settings, the event or an interrupt end it.

        Args:
            on_message: called after each message.
            is_stopped: ends it.

        Raises:
            CaptureError: if the disk fails; what was collected before stays.
        """
        start = time.monotonic()
        writer = threading.Thread(target=self._write, name="topic writer")
        writer.start()
        try:
            self._take(start, on_message, is_stopped)
        except KeyboardInterrupt:
            pass
        finally:
            self._queue.put(None)
            writer.join()
            size = self._file.close()
        if self._error:
            raise self._error
        return Collection(
            path=self._path,
            bytes=size,
            duration_s=time.monotonic() - start,
            topics=tuple(self._facts(name) for name in sorted(self._kinds)),
        )

    def _take(
        self, start: float, on_message: Callable[[], None], is_stopped: threading.Event
    ) -> None:
        settings, last = self._settings, None
        while not is_stopped.is_set() and self._error is None:
            messages = self._inbox.take(_POLL_S)
            now = time.monotonic()
            for message in messages:
                self._note(message)
                on_message()
            last = now if messages else last
            if settings.seconds is not None and now - start >= settings.seconds:
                return
            silent = last is not None and now - last
            if settings.silence_s is not None and silent and silent >= settings.silence_s:
                return

    def _note(self, message: ReceivedMessage) -> None:
        stamp = stamp_of(message.kind, message.data)
        if stamp is None:
            self._unstamped.add(message.topic)
        self._gaps[message.topic].add(message.source_ns if stamp is None else stamp)
        if self._taken - self._written + len(message.data) > QUEUE_BYTES:
            self._dropped[message.topic] += 1
            return
        self._taken += len(message.data)
        self._queue.put(message)

    def _write(self) -> None:
        while (message := self._queue.get()) is not None:
            if self._error is None:
                try:
                    self._file.add(
                        message.topic,
                        message.kind,
                        message.data,
                        log_ns=message.host_ns + self._epoch_ns,
                        publish_ns=message.source_ns,
                    )
                except Exception as error:
                    self._error = error
            self._written += len(message.data)

    def _facts(self, name: str) -> CollectedTopic:
        found, has_stamps = self._gaps[name].counted(), name not in self._unstamped
        step_ns = found.period_ns if has_stamps else found.mean_ns
        return CollectedTopic(
            name=name,
            kind=self._kinds[name],
            count=found.count,
            missing=found.missing if has_stamps else None,
            dropped=self._dropped[name],
            rate_hz=None if math.isnan(step_ns) else 1 / (step_ns * _NS),
            longest_gap_s=found.longest_ns * _NS,
            backward=found.backward,
        )
