"""Sharpness of images with sensor noise.

``labels.image_metrics.sharpness`` is for rendered images: in a real one, noise of two counts has
more edges than the picture, however blurred it is. Here the part of white noise is taken away.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

_LAPLACIAN = np.array([[1, 1, 1], [1, -8, 1], [1, 1, 1]], np.float32)
_NOISE = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
"""Sees noise and hardly any edge: Immerkaer, "Fast Noise Variance Estimation", 1996."""
_MEDIAN = 0.6745
"""Median of the absolute value of a standard normal variable."""
_RAW, _BLURRED = 72.0, 2.568
"""Variance of the Laplacian of white noise of variance 1: the sum of the squares of the kernel,
and of the kernel after a mean over 3 x 3 pixels."""
_LEAST = 0.1
"""Least variance of the picture, as a share of the noise's, at which it has edges."""


def noisy_sharpness(image: NDArray[np.uint8]) -> float:
    """Return what a mean over 3 x 3 pixels takes of the edges, 0 to 1, without those of noise.

    0 for an image without edges. It is that of ``labels.image_metrics.sharpness`` without noise.

    Args:
        image: Grey values (H, W).
    """
    values = image.astype(np.float32)
    noise = noise_level(values) ** 2
    blurred = np.asarray(cv2.blur(values, (3, 3)), np.float32)
    edges = _variance(values) - _RAW * noise
    kept = max(0.0, _variance(blurred) - _BLURRED * noise)
    has_edges = edges > _LEAST * _RAW * noise + 1.0
    return max(0.0, 1.0 - kept / edges) if has_edges else 0.0


def noise_level(values: NDArray[np.float32]) -> float:
    """Return the standard deviation of white noise in an image (H, W), in its unit."""
    if min(values.shape) < 3:
        return 0.0
    response = cv2.filter2D(values, -1, _NOISE)[1:-1, 1:-1]
    return float(np.median(np.abs(response))) / _MEDIAN / 6.0


def _variance(values: NDArray[np.float32]) -> float:
    return float(np.var(cv2.filter2D(values, -1, _LAPLACIAN)))
