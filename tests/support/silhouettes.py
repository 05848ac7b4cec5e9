"""Silhouettes of meshes, drawn without this package, to compare poses and shapes with images."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

BITS = 6
"""Binary digits of a pixel's fraction."""


def silhouette(
    points: NDArray[np.float64],
    faces: NDArray[np.int64],
    K: NDArray[np.float64],
    shape: tuple[int, int],
) -> NDArray[np.bool_]:
    """Return the mask (H, W) of a mesh with points (V, 3) in the camera frame."""
    pixels = (points @ K.T)[:, :2] / points[:, 2:]
    corners = np.round(pixels[faces] * 2**BITS).astype(np.int32)
    mask = np.zeros(shape, np.uint8)
    for triangle in corners:
        cv2.fillConvexPoly(mask, triangle, 1, shift=BITS)
    return mask.astype(bool)


def distance_outside(inner: NDArray[np.bool_], outer: NDArray[np.bool_]) -> float:
    """Return by how many pixels a mask reaches beyond another one."""
    if not inner.any():
        return 0.0
    away = cv2.distanceTransform((~outer).astype(np.uint8), cv2.DIST_L2, 5)
    return float(away[inner].max())
