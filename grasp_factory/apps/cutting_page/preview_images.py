"""Small pictures of a session's cameras over time, read in one pass by a process with limits."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from grasp_factory.apps.pictures.small_jpeg import small_jpeg
from grasp_factory.capture.privacy.camera_images import camera_image
from grasp_factory.capture.ros_messages import IMAGE
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import opened_session
from grasp_factory.capture.session_series import SESSION_LIMITS
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process
from grasp_factory.errors import GraspFactoryError

MOST_IMAGES = 600
"""Pictures of each camera."""
SHORTEST_S = 0.1
"""Shortest time between two pictures of a camera."""
WIDEST = 320
"""Pixels."""
MOST_BYTES = 200_000_000
"""Bytes of all pictures; those after them are left out."""
_QUALITY = 70


class Preview(NamedTuple):
    """A picture of a camera."""

    camera: str
    at_s: float
    """Seconds from the session's start, when it arrived."""
    jpeg: bytes


@dataclass(slots=True)
class Previews:
    """The pictures that have been read so far; several threads may use it."""

    times_s: dict[str, list[float]] = field(default_factory=dict)
    """By camera, ascending."""
    is_done: bool = False
    trouble: str = ""
    """Why reading ended early; empty if it did not."""
    _pictures: dict[str, list[bytes]] = field(default_factory=dict)
    _bytes: int = 0

    def start(self, session: Path, start_ns: int, duration_s: float) -> threading.Thread:
        """Read the pictures in a thread, and return it.

        Args:
            session: its folder.
            start_ns: its first time, ns since the epoch.
            duration_s: its length.
        """
        job = session, start_ns, max(SHORTEST_S, duration_s / MOST_IMAGES)
        thread = threading.Thread(target=self._read, args=(job,), daemon=True)
        thread.start()
        return thread

    def picture(self, camera: str, number: int) -> bytes | None:
        """Return a picture as a JPEG file, or None if the camera has no such picture."""
        pictures = self._pictures.get(camera, [])
        return pictures[number] if 0 <= number < len(pictures) else None

    def add(self, preview: Preview) -> None:
        """Keep a picture, unless there are too many bytes."""
        if self._bytes + len(preview.jpeg) > MOST_BYTES:
            self.trouble = f"pictures after {preview.at_s:.0f} s are left out: too many bytes"
            return
        self._bytes += len(preview.jpeg)
        self._pictures.setdefault(preview.camera, []).append(preview.jpeg)
        self.times_s.setdefault(preview.camera, []).append(preview.at_s)

    def _read(self, job: tuple[Path, int, float]) -> None:
        try:
            in_import_process(_read_previews, job, job[0], self.add, limits=SESSION_LIMITS)
        except GraspFactoryError as error:
            self.trouble = str(error)
        self.is_done = True


def _read_previews(job: tuple[Path, int, float], report: SendMessage) -> None:
    session, start_ns, step_s = job
    latest: dict[str, float] = {}
    with opened_session(session) as reader:
        for message in reader.messages():
            topic = message.topic
            if topic.message_type != IMAGE or topic.kind is not DeviceKind.CAMERA:
                continue
            at_s = (message.log_time_ns - start_ns) / 1e9
            if at_s < latest.get(topic.name, -np.inf) + step_s:
                continue
            latest[topic.name] = at_s
            image = camera_image(message)
            if not image.is_depth:
                bgr = np.ascontiguousarray(image.rgb()[..., ::-1])
                report(Preview(topic.device, at_s, small_jpeg(bgr, WIDEST, _QUALITY)))
