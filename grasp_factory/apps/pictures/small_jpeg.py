"""Small JPEG files of images of any size, for pages."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import BgrImage


def small_jpeg(image: BgrImage, widest: int, quality: int) -> bytes:
    """Return an image (H, W, 3) as a JPEG file; a large one is made smaller.

    Args:
        image: the image.
        widest: pixels, the largest width; the largest height is twice as much.
        quality: 0 to 100.
    """
    height, width = image.shape[:2]
    scale = min(1.0, widest / width, 2 * widest / height)
    if scale < 1.0:
        size = max(1, round(scale * width)), max(1, round(scale * height))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    data: NDArray[np.uint8] = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, quality))[1]
    return data.tobytes()
