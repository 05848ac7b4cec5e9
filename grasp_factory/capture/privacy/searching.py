"""The first pass over a session: search all images, and decide what is covered in each."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.privacy.blur_report import FoundInFrame
from grasp_factory.capture.privacy.blur_settings import BlurSettings
from grasp_factory.capture.privacy.camera_images import camera_image, is_camera_image
from grasp_factory.capture.privacy.detections import Detector, pixel_boxes
from grasp_factory.capture.session_reader import SessionReader
from grasp_factory.errors import CaptureError, shown

PixelBoxes = NDArray[np.int64]
_NONE: PixelBoxes = np.empty((0, 4), np.int64)


@dataclass(slots=True, kw_only=True)
class SearchedTopic:
    """What was found on one topic of colour images."""

    device: str
    size: tuple[int, int]
    """Width and height of the first image."""
    log_times: list[int] = field(default_factory=list)
    boxes: list[PixelBoxes] = field(default_factory=list)
    """To cover, by image."""
    frames: list[FoundInFrame] = field(default_factory=list)
    heights: dict[str, list[float]] = field(default_factory=dict)
    """Of the boxes as they were found, pixels."""
    _timeline: list[tuple[int, int]] = field(default_factory=list)

    def covered(self, image: int, carry: int) -> PixelBoxes:
        """Return what to cover in an image, with that of the images before and after it."""
        near = self.boxes[max(0, image - carry) : image + carry + 1]
        return np.concatenate([_NONE, *near])

    def covered_at(self, time_ns: int, carry: int) -> PixelBoxes:
        """Return what to cover in a depth image.

        It is that of the image of the same instant, or else of those before and after it.
        """
        timeline = self.timeline()
        first = bisect_left(timeline, (time_ns, 0))
        same = [image for time, image in timeline[first : first + 2] if time == time_ns]
        near = same or [image for _, image in timeline[max(0, first - 1) : first + 1]]
        return np.concatenate([_NONE, *(self.covered(image, carry) for image in near)])

    def timeline(self) -> list[tuple[int, int]]:
        """Return time and number of the images, by time."""
        if len(self._timeline) != len(self.log_times):
            self._timeline = sorted(zip(self.log_times, range(len(self.log_times)), strict=True))
        return self._timeline


def search(
    reader: SessionReader,
    detectors: Sequence[Detector],
    settings: BlurSettings,
    on_message: Callable[[], None],
) -> Mapping[str, SearchedTopic]:
    """Return what is in the images of each topic.

    Raises:
        CaptureError: if the session is damaged, or has images that cannot be searched.
    """
    found: dict[str, SearchedTopic] = {}
    depth_topics: set[str] = set()
    for message in reader.messages():
        on_message()
        if not is_camera_image(message.topic):
            continue
        name, image = message.topic.name, camera_image(message)
        if image.is_depth:
            depth_topics.add(name)
        if name in (found if image.is_depth else depth_topics):
            raise CaptureError(f"{shown(name)} has colour and depth images, valid: one of them")
        if image.is_depth:
            continue
        rgb = image.rgb()
        size = rgb.shape[1], rgb.shape[0]
        topic = found.setdefault(name, SearchedTopic(device=message.topic.device, size=size))
        if topic.size != size:
            raise CaptureError(f"{shown(name)} has images of {topic.size} and {size} pixels")
        _add(topic, rgb, message.log_time_ns, detectors, settings)
    return found


def _add(
    topic: SearchedTopic,
    rgb: NDArray[np.uint8],
    log_time_ns: int,
    detectors: Sequence[Detector],
    settings: BlurSettings,
) -> None:
    height, width = rgb.shape[:2]
    covered: list[PixelBoxes] = [_NONE]
    counts, scores = dict[str, int](), list[float]()
    for detector in detectors:
        found, score = detector.find(rgb)
        if len(found):
            covered.append(pixel_boxes(found, settings.margin, width, height))
            counts[detector.what] = len(found)
            scores += [round(float(each), 3) for each in score]
            heights = topic.heights.setdefault(detector.what, [])
            heights += (found[:, 3] - found[:, 1]).tolist()
    boxes = np.concatenate(covered)
    if counts:
        rectangles = [(int(a), int(b), int(c), int(d)) for a, b, c, d in boxes.tolist()]
        topic.frames.append(
            FoundInFrame(
                image=len(topic.boxes),
                log_time_ns=log_time_ns,
                found=counts,
                boxes=tuple(rectangles),
                scores=tuple(scores),
            )
        )
    topic.log_times.append(log_time_ns)
    topic.boxes.append(boxes)
