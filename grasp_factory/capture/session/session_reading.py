"""What a recorded session holds: rates, gaps, losses and alarms, by topic."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from mcap.records import Channel

from grasp_factory.capture.session import events
from grasp_factory.capture.session.mcap_scan import McapScan, MessageHead
from grasp_factory.capture.session.session_record import (
    DATA,
    RECOVERED,
    RecordedSession,
    read_record,
)
from grasp_factory.capture.session.topic_names import EVENTS
from grasp_factory.core.json_text import parsed
from grasp_factory.core.place import Place, place_of
from grasp_factory.core.serialization import is_integer
from grasp_factory.errors import CaptureError
from grasp_factory.writers.exporters.rosbag.bag_files import ros2_types

SEQUENCES = 2**32
LARGEST_EVENT = 64 * 1024
MOST_EVENTS = 10_000
"""Events that are read; a session has some hundred."""
MOST_EVENT_BYTES = 8 * 2**20
"""Of all events that are read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamFacts:
    """A topic of a session."""

    topic: str
    device: str
    kind: str
    """Type of its messages."""
    messages: int
    rate_hz: float | None
    """None with fewer than two messages."""
    longest_gap_s: float | None
    lost: int
    """Messages that are missing by the device's own count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionFacts:
    """A session as it lies on the disk."""

    path: str
    is_complete: bool
    """Whether its MCAP file has its end."""
    start_ns: int | None
    """Of the first message, ns since the epoch; None without messages."""
    end_ns: int | None
    bytes: int
    topics: tuple[StreamFacts, ...]
    events: tuple[Mapping[str, Any], ...]
    """Its events, in order."""
    record: RecordedSession | None
    """``session.json``; None if the session did not end."""

    @property
    def duration_s(self) -> float:
        """Seconds from the first to the last message."""
        if self.start_ns is None or self.end_ns is None:
            return 0.0
        return (self.end_ns - self.start_ns) / 1e9


@dataclass(slots=True)
class _Stream:
    """What is counted of a topic."""

    channel: Channel
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_ns: int = 0
    lost: int = 0
    sequence: int | None = None
    has_sequence: bool = field(init=False)

    def __post_init__(self) -> None:
        self.has_sequence = self.channel.metadata.get("device_sequence") == "1"

    def add(self, head: MessageHead) -> None:
        if self.count:
            self.longest_ns = max(self.longest_ns, head.log_ns - self.last_ns)
        else:
            self.first_ns = head.log_ns
        if self.has_sequence:
            self.lost += missing(self.sequence, head.sequence)
            self.sequence = head.sequence
        self.count, self.last_ns = self.count + 1, head.log_ns

    def facts(self, kind: str) -> StreamFacts:
        span = self.last_ns - self.first_ns
        is_series = self.count > 1 and span > 0
        return StreamFacts(
            topic=self.channel.topic,
            device=self.channel.metadata.get("device", ""),
            kind=kind,
            messages=self.count,
            rate_hz=1e9 * (self.count - 1) / span if is_series else None,
            longest_gap_s=self.longest_ns / 1e9 if is_series else None,
            lost=self.lost,
        )


def missing(before: int | None, sequence: int) -> int:
    """Return how many numbers, modulo 2**32, lie between two; 0 if the count began again."""
    if before is None:
        return 0
    step = (sequence - before) % SEQUENCES
    return step - 1 if 0 < step < SEQUENCES // 2 else 0


@contextmanager
def open_scan(file: Place, *, with_checksums: bool = False) -> Iterator[McapScan]:
    """Yield a pass over an MCAP file.

    Raises:
        CaptureError: if it is not there, or no MCAP file.
        RefusedFileError: if it is a link.
    """
    try:
        descriptor = file.open()
    except OSError as error:
        raise CaptureError(f"{file} cannot be read: {error.strerror}; valid: a session") from None
    try:
        yield McapScan(descriptor, with_checksums=with_checksums, where=file)
    except CaptureError as error:
        raise CaptureError(f"{file}: {error}") from None
    finally:
        os.close(descriptor)


def session_place(path: Path) -> Place:
    """Return the place of a session's folder.

    Raises:
        CaptureError: if it is not one.
    """
    try:
        folder = place_of(path)
    except OSError as error:
        raise CaptureError(f"{path} is no session: {error.strerror}") from None
    if not (folder / DATA).exists():
        raise CaptureError(f"{path} is no session: it has no {DATA}")
    return folder


def session_file(folder: Place) -> Place:
    """Return the file of a session to read: the recovered one if there is one."""
    recovered = folder / RECOVERED
    return recovered if recovered.exists() else folder / DATA


def read_session(path: Path) -> SessionFacts:
    """Return what a session holds; one that was killed is read as far as it is whole.

    Raises:
        CaptureError: if it is no session, or damaged.
        RefusedFileError: if a file of it is a link, or too large.
    """
    folder = session_place(path)
    with open_scan(session_file(folder)) as scan:
        streams: dict[int, _Stream] = {}
        events = _Events()
        for head in scan.messages():
            if head.channel_id not in streams:
                streams[head.channel_id] = _Stream(scan.channels[head.channel_id])
            streams[head.channel_id].add(head)
            if streams[head.channel_id].channel.topic == EVENTS:
                events.add(head)
        kinds = {n: scan.schemas[channel.schema_id].name for n, channel in scan.channels.items()}
        topics = tuple(stream.facts(kinds[n]) for n, stream in streams.items())
        return SessionFacts(
            path=str(path),
            is_complete=scan.is_complete,
            start_ns=min((s.first_ns for s in streams.values()), default=None),
            end_ns=max((s.last_ns for s in streams.values()), default=None),
            bytes=scan.size,
            topics=tuple(sorted(topics, key=lambda topic: topic.topic)),
            events=tuple(events.said),
            record=read_record(folder),
        )


class _Events:
    """The events of a session, as far as they are read."""

    def __init__(self) -> None:
        self.said: list[Mapping[str, Any]] = []
        self._bytes = 0

    def add(self, head: MessageHead) -> None:
        """Read an event, unless it is too large or there are too many."""
        size = self._bytes + head.size
        is_small = head.size <= LARGEST_EVENT and size <= MOST_EVENT_BYTES
        if is_small and len(self.said) < MOST_EVENTS:
            self._bytes = size
            self.said.append(read_event(head.data()))


def read_event(data: bytes) -> Mapping[str, Any]:
    """Return the content of a message on the topic of events.

    Raises:
        CaptureError: if it is not one.
    """
    try:
        message: Any = ros2_types().deserialize_cdr(data, "std_msgs/msg/String")
        found = parsed(message.data)
        if isinstance(found, dict) and isinstance(found["event"], str):
            json.dumps(found, allow_nan=False)
            if all(_is_small(found.get(key, 0)) for key in ("time_ns", "count")):
                return found
    except Exception:
        pass
    raise CaptureError(f"a message on {EVENTS} is damaged: it is no JSON with the key event")


def _is_small(number: Any) -> bool:
    """Return whether a number of an event is one that a recorder writes."""
    return is_integer(number) and abs(number) < 2**63


def seconds_between(start: str, end: str) -> float:
    """Return the seconds between two times of ``session.json``."""
    first, last = (datetime.fromisoformat(text) for text in (start, end))
    return (last - first).total_seconds()


def dropped_samples(facts: SessionFacts) -> dict[str, int]:
    """Return the samples that were dropped or lost by device, as events and record count them."""
    found: dict[str, int] = {}
    for event in facts.events:
        device, number = event.get("device"), event.get("count")
        is_drop = event["event"] == events.SAMPLES_DROPPED and isinstance(device, str)
        if is_drop and isinstance(number, int):
            found[str(device)] = found.get(str(device), 0) + number
    if facts.record is not None:
        found |= {name: device.dropped for name, device in facts.record.devices.items()}
    return found
