"""The images of a session's episodes, read in one pass by a process with limits."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.privacy.camera_images import camera_image, is_camera_image
from grasp_factory.capture.quality.image_series import ImageMeasures
from grasp_factory.capture.session_reader import SessionMessage, opened_session
from grasp_factory.capture.session_series import SESSION_LIMITS
from grasp_factory.core.executors import SendMessage
from grasp_factory.core.executors.import_process import in_import_process

Frame = tuple[str, int]
"""A topic and the place of a message among those of the topic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WantedImages:
    """What an episode needs."""

    frames: frozenset[Frame]
    """Images to keep."""
    measured: Mapping[str, tuple[int, int]]
    """By topic of colour images: the first place, and the one after the last, to measure."""

    @property
    def last(self) -> dict[str, int]:
        """The last place that is needed, by topic."""
        ends: dict[str, int] = {}
        for topic, place in self.frames:
            ends[topic] = max(ends.get(topic, -1), place)
        for topic, (first, stop) in self.measured.items():
            if stop > first:
                ends[topic] = max(ends.get(topic, -1), stop - 1)
        return ends


@dataclass(slots=True, kw_only=True)
class FoundImages:
    """The images of an episode."""

    episode: int
    frames: dict[Frame, NDArray[Any]] = field(default_factory=dict)
    """Colours (H, W, 3) uint8, depths (H, W) uint16 in mm."""
    measures: dict[str, ImageMeasures] = field(default_factory=dict)
    """By topic."""


def read_images(
    session: Path, wanted: Sequence[WantedImages], on_episode: Callable[[FoundImages], None]
) -> None:
    """Read the images of episodes; each is handed on as soon as its last image is read.

    Args:
        session: its folder.
        wanted: what each episode needs, in the order of their starts.
        on_episode: takes the images of each, in this order.

    Raises:
        CaptureError: if the session is damaged, or an image cannot be decoded.
    """
    in_import_process(
        _read_images, (session, tuple(wanted)), session, on_episode, limits=SESSION_LIMITS
    )


def _read_images(job: tuple[Path, tuple[WantedImages, ...]], report: SendMessage) -> None:
    session, wanted = job
    waiting = [_Waiting(FoundImages(episode=k), want, want.last) for k, want in enumerate(wanted)]
    places: Counter[str] = Counter()
    with opened_session(session) as reader:
        for message in reader.messages():
            while waiting and not waiting[0].open:
                report(waiting.pop(0).found)
            if not waiting:
                return
            if not is_camera_image(message.topic):
                continue
            topic = message.topic.name
            place = places[topic]
            places[topic] += 1
            for each in waiting:
                if topic in each.open:
                    each.take(message, topic, place)
    for each in waiting:
        report(each.found)


@dataclass(slots=True)
class _Waiting:
    """An episode that still needs images, with the last place of each topic."""

    found: FoundImages
    wanted: WantedImages
    open: dict[str, int]

    def take(self, message: SessionMessage, topic: str, place: int) -> None:
        first, stop = self.wanted.measured.get(topic, (0, 0))
        is_kept, is_measured = (topic, place) in self.wanted.frames, first <= place < stop
        if is_kept or is_measured:
            image = camera_image(message)
            if is_measured:
                self.found.measures.setdefault(topic, ImageMeasures()).add(image.rgb())
            if is_kept:
                pixels = image.pixels
                kept = pixels.view("<u2")[..., 0] if image.is_depth else image.rgb()
                self.found.frames[topic, place] = np.ascontiguousarray(kept)
        if place >= self.open[topic]:
            del self.open[topic]
