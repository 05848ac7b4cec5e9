"""Mosaic of boxes in images: of what was there, only a few mean colours are left."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

TILES = 3
"""Tiles along the longer side of a box, whatever its size in pixels. With 5 or 8 tiles, the mosaic
of a face of 11 to 20 pixels looks like a face to the model."""


def mosaic(pixels: NDArray[np.uint8], boxes: NDArray[np.int64], tiles: int = TILES) -> None:
    """Replace each box of an image (H, W, C) by large tiles of their mean colour, in place.

    Args:
        pixels: the image.
        boxes: (N, 4) whole pixels inside the image; see ``detections.pixel_boxes``.
        tiles: how many along the longer side of a box.
    """
    for left, top, right, bottom in boxes.tolist():
        part = pixels[top:bottom, left:right]
        height, width = part.shape[:2]
        tile = max(1.0, max(height, width) / tiles)
        size = (max(1, round(width / tile)), max(1, round(height / tile)))
        small = cv2.resize(part, size, interpolation=cv2.INTER_AREA)
        large = cv2.resize(small, (width, height), interpolation=cv2.INTER_NEAREST)
        part[:] = large.reshape(part.shape)


def erase(pixels: NDArray[np.uint8], boxes: NDArray[np.int64]) -> None:
    """Replace each box of an image (H, W, C) by zeros, in place."""
    for left, top, right, bottom in boxes.tolist():
        pixels[top:bottom, left:right] = 0
