"""Boxes that a detector found in an image, and the geometry of boxes."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array

Boxes = Array
"""(N, 4): left, top, right, bottom in pixels."""
OVERLAP = 0.3
"""Intersection over union above which the weaker of two boxes is dropped."""

MOST = 1000
"""Boxes of an image that are considered, the strongest."""


class Detections(NamedTuple):
    """What one detector found in one image."""

    boxes: Boxes
    """(N, 4)."""
    scores: Array
    """(N,) 0 to 1."""


class Detector(Protocol):
    """Finds one kind of thing in images."""

    what: str
    """What it finds, such as ``face``."""
    model: str
    """Name of the model's file."""
    sha256: str
    """Of the model's file."""
    threshold: float
    """The least score of what counts as found."""

    def find(self, rgb: NDArray[np.uint8]) -> Detections:
        """Return what is in an image (H, W, 3)."""


NOTHING = Detections(np.empty((0, 4)), np.empty(0))


def strongest(boxes: Boxes, scores: Array, threshold: float) -> Detections:
    """Return the boxes of at least a score, without those that overlap a stronger one.

    Greedy non-maximum suppression by OpenCV.
    """
    first = np.argsort(-scores, kind="stable")[:MOST]
    first = first[scores[first] >= threshold]
    if not len(first):
        return NOTHING
    boxes, scores = boxes[first], scores[first]
    rectangles = np.column_stack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]]).astype(np.float64)
    kept = cv2.dnn.NMSBoxes(rectangles.tolist(), scores.tolist(), threshold, OVERLAP)
    chosen = np.asarray(kept, np.int64).ravel()
    return Detections(boxes[chosen], scores[chosen])


def pixel_boxes(boxes: Boxes, margin: float, width: int, height: int) -> NDArray[np.int64]:
    """Return boxes as whole pixels inside an image, larger on each side by a share of their size.

    Args:
        boxes: (N, 4).
        margin: the share; 0.25 makes a box 1.5 times as wide and high.
        width: of the image.
        height: of the image.

    Returns:
        (M, 4) left, top, right, bottom; right and bottom are behind the last pixel. Boxes outside
        of the image are left out.
    """
    size = np.maximum(boxes[:, 2:] - boxes[:, :2], 1.0)
    low = np.floor(boxes[:, :2] - margin * size)
    high = np.ceil(boxes[:, 2:] + margin * size)
    most = np.array([width, height], np.float64)
    found = np.concatenate([np.clip(low, 0, most), np.clip(high, 0, most)], axis=1).astype(np.int64)
    is_inside = (found[:, 2:] > found[:, :2]).all(axis=1)
    return np.asarray(found[is_inside], np.int64)
