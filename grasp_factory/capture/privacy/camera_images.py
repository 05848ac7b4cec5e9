"""The images of a session's cameras, and what of them may be kept or must be searched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.ros_messages import (
    COMPRESSED_IMAGE,
    IMAGE,
    decoded,
    encoded,
    image_rows,
    with_rows,
)
from grasp_factory.capture.samples import DeviceKind
from grasp_factory.capture.session_reader import SessionMessage, SessionTopic
from grasp_factory.errors import CaptureError, shown

_DEPTH = "16UC1"
_COLOURS = ("rgb8", "bgr8", "mono8")


@dataclass(frozen=True, slots=True)
class SearchedImage:
    """An image message of a camera."""

    record: Any
    """The message."""
    pixels: NDArray[np.uint8]
    """(H, W, bytes of a pixel); may be changed."""

    @property
    def is_depth(self) -> bool:
        """Whether it is a depth image."""
        return bool(self.record.encoding == _DEPTH)

    def rgb(self) -> NDArray[np.uint8]:
        """Return the colours (H, W, 3)."""
        if self.record.encoding == "bgr8":
            return np.ascontiguousarray(self.pixels[..., ::-1])
        if self.record.encoding == "mono8":
            return np.repeat(self.pixels, 3, axis=2)
        return self.pixels

    def message(self) -> bytes:
        """Return the bytes of the message with the pixels as they are now."""
        self.record.data = with_rows(self.record, self.pixels)
        return encoded(self.record, IMAGE)


def is_camera_image(topic: SessionTopic) -> bool:
    """Return whether the messages of a topic are images that people may be in.

    An image that is not known to be that of a tactile sensor counts as one.

    Raises:
        CaptureError: for compressed images, which are not searched.
    """
    if topic.message_type == COMPRESSED_IMAGE:
        raise CaptureError(
            f"{shown(topic.name)} has compressed images, which cannot be blurred; valid: raw images"
        )
    return topic.message_type == IMAGE and topic.kind is not DeviceKind.TACTILE


def camera_image(message: SessionMessage) -> SearchedImage:
    """Return the image of a message.

    Raises:
        CaptureError: if it cannot be decoded, or is in an encoding that is not searched.
    """
    record = decoded(message)
    if record.encoding not in (*_COLOURS, _DEPTH):
        raise CaptureError(
            f"{shown(message.topic.name)} has images of {shown(record.encoding)}, which cannot be"
            f" blurred; valid: {', '.join((*_COLOURS, _DEPTH))}"
        )
    return SearchedImage(record, image_rows(record, message.topic.name))
