"""Small pictures for pages, of images of any size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from grasp_factory.apps.pictures.small_jpeg import small_jpeg


@pytest.mark.parametrize(
    ("height", "width", "shown"),
    [
        (48, 64, (48, 64)),
        (480, 640, (240, 320)),
        (1280, 480, (640, 240)),
        (70_000, 16, (640, 1)),
        (16, 70_000, (1, 320)),
        (1, 1, (1, 1)),
    ],
)
def test_a_picture_has_the_proportions_of_its_image_as_far_as_it_can(
    height: int, width: int, shown: tuple[int, int]
) -> None:
    """A JPEG file holds 65,500 pixels a side."""
    data = small_jpeg(np.full((height, width, 3), 90, np.uint8), 320, 70)
    read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert read is not None
    assert read.shape[:2] == shown
    assert np.abs(read.astype(int) - 90).max() <= 2
