"""Surfaces in a depth image: edges, incidence angles, and points hidden from a second view.

All functions take inverse depth, which is linear over the pixels of a plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array

DepthImage = NDArray[np.float32]


def bends(inverse: DepthImage) -> DepthImage:
    """Return the larger second difference of an image along rows and columns, (H, W).

    For inverse depth it is 0 on planes of any slant, and large on both sides of an edge.
    """
    out = np.zeros_like(inverse)
    down, across = (np.abs(np.diff(inverse, n=2, axis=axis)) for axis in (0, 1))
    out[1:-1] = down
    np.maximum(out[:, 1:-1], across, out=out[:, 1:-1])
    return out


def incidence(inverse: DepthImage, K: Array) -> DepthImage:
    """Return the angle between each pixel's surface normal and its line of sight, (H, W) rad.

    On a plane ``n X = 1`` inverse depth is ``n K^-1 (u, v, 1)``, so its slopes along the image
    yield the normal exactly and without noise.

    Args:
        inverse: (H, W) 1/m.
        K: (3, 3) pixels.
    """
    fx, fy, cx, cy = (np.float32(K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2)))
    height, width = inverse.shape
    u = np.arange(width, dtype=np.float32) - cx
    v = (np.arange(height, dtype=np.float32) - cy)[:, None]
    across, down = _slope(inverse, 1), _slope(inverse, 0)
    along = inverse - u * across - v * down
    normal = (fx * across) ** 2 + (fy * down) ** 2 + along**2
    sight = (u / fx) ** 2 + (v / fy) ** 2 + np.float32(1.0)
    cosine = inverse / np.sqrt(np.maximum(normal * sight, np.float32(1e-30)))
    return np.asarray(np.arccos(np.minimum(cosine, np.float32(1.0))), np.float32)


def shadow(inverse: DepthImage, focal_baseline: float) -> NDArray[np.bool_]:
    """Return where a nearer point hides a pixel's point from a second view, (H, W).

    The second view is one baseline to the right and sees the point of column u at ``u - f B / z``.
    The point is hidden if a point of a column further right appears left of that position.

    Args:
        inverse: (H, W) 1/m.
        focal_baseline: ``f B``, in pixels of this image times metres.
    """
    at = np.arange(inverse.shape[1], dtype=np.float32) - np.float32(focal_baseline) * inverse
    leftmost = np.minimum.accumulate(at[:, :0:-1], axis=1)[:, ::-1]
    hidden = np.zeros(inverse.shape, np.bool_)
    hidden[:, :-1] = leftmost < at[:, :-1]
    return hidden


def _slope(image: DepthImage, axis: int) -> DepthImage:
    """Return the change per pixel along an axis, (H, W).

    It is the smaller one of the steps to the two neighbours, or 0 if they differ in sign (the
    minmod limiter of Roe 1986), so that an edge next to a pixel does not tilt its surface.
    """
    step = np.diff(image, axis=axis)
    before = np.concatenate([np.take(step, [0], axis), step], axis)
    after = np.concatenate([step, np.take(step, [-1], axis)], axis)
    rise = np.maximum(np.minimum(before, after), 0.0)
    return np.asarray(rise + np.minimum(np.maximum(before, after), 0.0), np.float32)
