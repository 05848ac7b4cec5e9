"""A picture of what was covered in a session's images, as it is after that."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from grasp_factory.apps.pictures import painting
from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.capture.privacy.covering import Covered

COLUMNS, SIDE, GAP, HEADER, CAPTION = 8, 128, 8, 44, 20
"""Pictures in a row, and pixels."""


def draw_covered(pictures: Sequence[Covered], title: str) -> BgrImage:
    """Return the sheet, BGR: a caption and the surroundings of a box for each picture."""
    rows = -(-len(pictures) // COLUMNS)
    width = GAP + COLUMNS * (SIDE + GAP)
    height = HEADER + max(rows, 1) * (CAPTION + SIDE + GAP)
    sheet: BgrImage = np.full((height, width, 3), painting.PAPER, np.uint8)
    painting.put_text(sheet, title, (GAP, HEADER // 2), painting.INK, 15)
    for k, picture in enumerate(pictures):
        left = GAP + k % COLUMNS * (SIDE + GAP)
        top = HEADER + k // COLUMNS * (CAPTION + SIDE + GAP)
        text = f"{picture.topic} {picture.image}"[-20:]
        painting.put_text(sheet, text, (left, top + CAPTION // 2), painting.PALE, 10)
        area = _fitted(picture)
        at = slice(top + CAPTION, top + CAPTION + area.shape[0]), slice(left, left + area.shape[1])
        sheet[at] = area
    return sheet


def _fitted(picture: Covered) -> BgrImage:
    height, width = picture.pixels.shape[:2]
    scale = SIDE / max(height, width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    bgr = np.ascontiguousarray(picture.pixels[..., ::-1])
    return np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_NEAREST), np.uint8)
