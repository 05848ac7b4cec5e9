"""Silhouettes of models, also of parts that are hidden or outside the image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_BITS = 4
"""Binary digits of a pixel's fraction when triangles are drawn."""


def silhouette(
    pixels: NDArray[np.float64], faces: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return the silhouette of a mesh in an image and in the eight images around it.

    BOP's ``scripts/calc_gt_info.py`` counts the pixels of an object in the same area.

    Args:
        pixels: its vertices in the image, (V, 2) as (x, y), up to 10^6.
        faces: its triangles, (F, 3).
        shape: height and width of the image.

    Returns:
        The mask, (3 H, 3 W), whose middle part is the image. Its edge is within a pixel.
    """
    height, width = shape
    mask = np.zeros((3 * height, 3 * width), np.uint8)
    moved = pixels + np.array([width, height])
    for triangle in np.round(moved[faces] * 2**_BITS).astype(np.int32):
        cv2.fillConvexPoly(mask, triangle, 1, shift=_BITS)
    return mask.astype(np.bool_)
