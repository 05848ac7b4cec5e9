"""What a session holds but for its images, read once by a process with limits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.bags.payloads import taxel_reading
from grasp_factory.capture.privacy.camera_images import is_camera_image
from grasp_factory.capture.ros_messages import IMAGE, decoded
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import (
    CALIBRATION_FOLDER,
    EVENTS_TOPIC,
    SETTINGS_FILE,
    SessionMessage,
    opened_session,
)
from grasp_factory.capture.session_series import SESSION_LIMITS, DeviceSeries, SeriesBuilder
from grasp_factory.capture.session_settings import session_settings
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.core.geometry import Array
from grasp_factory.core.json_text import parsed
from grasp_factory.core.limits import DOCUMENT
from grasp_factory.core.place import place_of
from grasp_factory.core.place_tree import entries
from grasp_factory.errors import CaptureError, shown

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
_MOST_EVENTS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedEvent:
    """An event of a session."""

    name: str
    time_ns: int
    """Time of the host, ns since the epoch."""
    fields: Mapping[str, Any]


@dataclass(slots=True, kw_only=True)
class SessionContents:
    """A session in memory, without its images."""

    name: str
    path: str
    sha256: str
    """SHA-256 (hex) of ``session.mcap``."""
    calibration_sha256: str
    """SHA-256 over session.yaml and the calibration files: name and content of each."""
    settings: Mapping[str, Any]
    """``session.yaml``."""
    series: Mapping[str, DeviceSeries] = field(default_factory=dict)
    """By topic."""
    events: tuple[RecordedEvent, ...] = ()
    taxels: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    """(N, rows, columns) by topic."""
    intrinsics: Mapping[str, Array] = field(default_factory=dict)
    """K (3, 3) by device, pixels."""
    depth_topics: frozenset[str] = frozenset()
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Width and height by topic, of the first image."""

    @property
    def span(self) -> tuple[int, int]:
        """The first and the last time of a message, ns.

        Raises:
            CaptureError: if there is none.
        """
        ends = [
            (each.log_time_ns.min(), each.log_time_ns.max())
            for each in self.series.values()
            if len(each)
        ]
        if not ends:
            raise CaptureError(f"{self.path} has no messages: there is nothing to import")
        return int(min(first for first, _ in ends)), int(max(last for _, last in ends))


def read_contents(session: Path) -> SessionContents:
    """Return what a session holds but for its images.

    Raises:
        CaptureError: if it is no session, or damaged.
        StoreError: if it needs too much memory or time.
    """
    settings = session_settings(session)
    contents: SessionContents = in_import_process(_read, session, session, limits=SESSION_LIMITS)
    contents.settings, contents.calibration_sha256 = settings, _calibration_sha256(session)
    return contents


@dataclass(slots=True)
class _Collector:
    builders: dict[str, SeriesBuilder] = field(default_factory=dict)
    events: list[RecordedEvent] = field(default_factory=list)
    taxels: dict[str, list[NDArray[np.float32]]] = field(default_factory=dict)
    intrinsics: dict[str, Array] = field(default_factory=dict)
    depth: set[str] = field(default_factory=set)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)

    def add(self, message: SessionMessage) -> None:
        topic = message.topic
        self.builders.setdefault(topic.name, SeriesBuilder(topic)).add(message)
        if topic.name == EVENTS_TOPIC:
            self._add_event(message)
        elif topic.message_type == IMAGE and topic.kind is DeviceKind.TACTILE:
            self._add_taxels(message)
        elif topic.message_type == CAMERA_INFO and topic.device not in self.intrinsics:
            K = np.array(decoded(message).k, np.float64).reshape(3, 3)
            self.intrinsics[topic.device] = K
        elif topic.name not in self.sizes and is_camera_image(topic):
            image = decoded(message)
            self.sizes[topic.name] = int(image.width), int(image.height)
            self.depth |= {topic.name} if image.encoding == "16UC1" else set()

    def _add_event(self, message: SessionMessage) -> None:
        text = str(decoded(message).data)
        try:
            fields = dict(parsed(text))
            name = str(fields.pop("event"))
            json.dumps(fields, ensure_ascii=False).encode()  # fails for half a surrogate pair
        except (ValueError, TypeError, KeyError, RecursionError):
            raise CaptureError(f"an event is no JSON with a name: {shown(text)}") from None
        self.events.append(RecordedEvent(name=name, time_ns=message.log_time_ns, fields=fields))
        if len(self.events) > _MOST_EVENTS:
            raise CaptureError(f"more than {_MOST_EVENTS} events")

    def _add_taxels(self, message: SessionMessage) -> None:
        topic = message.topic
        try:
            frame = taxel_reading(decoded(message)).pressure.astype(np.float32)
        except ValueError as error:
            raise CaptureError(f"{shown(topic.name)}: {error}") from None
        frames = self.taxels.setdefault(topic.name, [])
        if frames and frames[0].shape != frame.shape:
            raise CaptureError(f"{shown(topic.name)} has frames of several sizes")
        frames.append(frame)


def _read(session: Path, report: SendMessage) -> SessionContents:
    found = _Collector()
    with opened_session(session) as reader:
        for message in reader.messages():
            found.add(message)
        reader.stream.seek(0)
        sha256 = hashlib.file_digest(reader.stream, "sha256").hexdigest()  # type: ignore[arg-type]
    return SessionContents(
        name=session.resolve().name,
        path=str(session),
        sha256=sha256,
        calibration_sha256="",
        settings={},
        series={name: builder.series() for name, builder in sorted(found.builders.items())},
        events=tuple(sorted(found.events, key=lambda event: event.time_ns)),
        taxels={name: np.stack(frames) for name, frames in found.taxels.items()},
        intrinsics=found.intrinsics,
        depth_topics=frozenset(found.depth),
        image_sizes=found.sizes,
    )


def _calibration_sha256(session: Path) -> str:
    place = place_of(session)
    folder = place / CALIBRATION_FOLDER
    names = sorted(entries(folder).files) if folder.is_dir() else []
    files = {SETTINGS_FILE: place / SETTINGS_FILE} | {name: folder / name for name in names}
    digests = {
        name: hashlib.sha256(file.read_bytes(DOCUMENT)).hexdigest() for name, file in files.items()
    }
    return hashlib.sha256(json.dumps(digests, sort_keys=True).encode()).hexdigest()
