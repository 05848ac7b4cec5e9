"""The second pass over a session: cover what was found, in images and in depth images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.privacy.blur_settings import BlurSettings
from grasp_factory.capture.privacy.camera_images import SearchedImage, camera_image, is_camera_image
from grasp_factory.capture.privacy.detections import Detector, pixel_boxes
from grasp_factory.capture.privacy.mosaic import erase, mosaic
from grasp_factory.capture.privacy.searching import SearchedTopic
from grasp_factory.capture.session_reader import SessionMessage, SessionTopic
from grasp_factory.errors import CaptureError, shown

_ROUNDS = 8
"""How often what is still found is covered again, each time with a wider margin."""
MOST_PICTURES = 24
"""Examples on the contact sheet, of each topic."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Covered:
    """An example for the contact sheet."""

    topic: str
    image: int
    pixels: NDArray[np.uint8]
    """(H, W, 3) RGB of one box with its surroundings, as it is now."""


@dataclass(slots=True, kw_only=True)
class ImageCover:
    """Covers the messages of a session one after the other."""

    searched: Mapping[str, SearchedTopic]
    detectors: Sequence[Detector]
    settings: BlurSettings
    counts: Counter[str] = field(default_factory=Counter)
    """Images so far by topic."""
    changed: Counter[str] = field(default_factory=Counter)
    left: dict[str, Counter[str]] = field(default_factory=dict)
    depth_topics: set[str] = field(default_factory=set)
    pictures: list[Covered] = field(default_factory=list)

    def covered(self, message: SessionMessage) -> bytes:
        """Return the bytes of a message, the same ones unless something in it is covered.

        Raises:
            CaptureError: if a depth image has another size than the colour image with a box.
        """
        topic = message.topic
        if not is_camera_image(topic):
            return message.data
        if topic.name not in self.searched:
            return self._depth(message)
        number = self.counts[topic.name]
        self.counts[topic.name] += 1
        boxes = self.searched[topic.name].covered(number, self.settings.carry_frames)
        if not len(boxes):
            return message.data
        image = camera_image(message)
        mosaic(image.pixels, boxes)
        self._cover_what_is_left(topic.name, image)
        self.changed[topic.name] += 1
        self._add_picture(topic.name, number, image)
        return image.message()

    def _cover_what_is_left(self, name: str, image: SearchedImage) -> None:
        height, width = image.pixels.shape[:2]
        for turn in range(_ROUNDS + 1):
            found = {each.what: each.find(image.rgb()).boxes for each in self.detectors}
            if not any(map(len, found.values())):
                return
            if turn < _ROUNDS:
                boxes = np.concatenate(list(found.values()))
                margin = self.settings.margin * (turn + 1)
                mosaic(image.pixels, pixel_boxes(boxes, margin, width, height), 1)
        counts = self.left.setdefault(name, Counter())
        counts.update({what: len(boxes) for what, boxes in found.items()})

    def _depth(self, message: SessionMessage) -> bytes:
        image = camera_image(message)
        if not image.is_depth:
            raise CaptureError(
                f"{shown(message.topic.name)}: a colour image came that was not there before"
            )
        self.depth_topics.add(message.topic.name)
        height, width = image.pixels.shape[:2]
        carry = self.settings.carry_frames
        found = {
            name: boxes
            for name in self._colour_topics(message.topic)
            if len(boxes := self.searched[name].covered_at(message.log_time_ns, carry))
        }
        if not found:
            return message.data
        for name in found:
            if self.searched[name].size != (width, height):
                raise CaptureError(
                    f"{shown(message.topic.name)}: depth images of {width} x {height} pixels do not"
                    f" fit the images of {shown(name)}, so that faces in them cannot be covered"
                )
        erase(image.pixels, np.concatenate(list(found.values())))
        return image.message()

    def _colour_topics(self, depth: SessionTopic) -> list[str]:
        return [name for name, each in self.searched.items() if each.device == depth.device]

    def _add_picture(self, name: str, number: int, image: SearchedImage) -> None:
        boxes = self.searched[name].boxes[number]
        known = sum(picture.topic == name for picture in self.pictures)
        if not len(boxes) or known >= MOST_PICTURES:
            return
        left, top, right, bottom = boxes[0].tolist()
        side = max(right - left, bottom - top)
        area = image.rgb()[
            max(0, top - side // 2) : bottom + side // 2,
            max(0, left - side // 2) : right + side // 2,
        ]
        self.pictures.append(Covered(topic=name, image=number, pixels=area.copy()))
