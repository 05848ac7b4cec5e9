"""A face for tests: Grace Hopper's portrait, which matplotlib has among its sample data.

The photograph is a work of the U.S. Navy (James S. Davis, 1984), in the public domain.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from numpy.typing import NDArray

FACE_HEIGHT = 205
"""Of the face in the portrait, pixels, as the model sees it."""


@cache
def portrait() -> NDArray[np.uint8]:
    """Return the portrait (600, 512, 3) RGB."""
    path = Path(matplotlib.get_data_path()) / "sample_data" / "grace_hopper.jpg"
    image = cv2.imread(str(path))
    assert image is not None
    return np.ascontiguousarray(image[..., ::-1])


def face_of(height: float) -> NDArray[np.uint8]:
    """Return the portrait at a size at which the face is so many pixels high."""
    scale = height / FACE_HEIGHT
    small = cv2.resize(portrait(), None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def scene(
    width: int, height: int, face: float | None, at: tuple[int, int] = (8, 8)
) -> NDArray[np.uint8]:
    """Return a grey image, with a face of a height in pixels, whose portrait begins at ``at``."""
    image = np.full((height, width, 3), 120, np.uint8)
    if face is not None:
        part = face_of(face)[: height - at[1], : width - at[0]]
        image[at[1] : at[1] + part.shape[0], at[0] : at[0] + part.shape[1]] = part
    return image
