"""Compares the frames of a lossy video with those that were encoded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LEAST_DB = 25.0
"""Peak signal-to-noise ratio of small images; half of their colours' pixels are not stored."""


def assert_same_video(found: NDArray[Any], wanted: NDArray[np.uint8]) -> None:
    """Fail unless frames (K, H, W, 3) from 0 to 255 are the wanted ones, in the same order.

    A frame must be like its own original, and more so than like a neighbour that looks different.
    """
    assert found.shape == wanted.shape
    own = errors(found, wanted)
    assert 10.0 * np.log10(255.0**2 / max(own.mean(), 1e-9)) > LEAST_DB
    compared = 0
    for here, there in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        is_other = errors(wanted[here], wanted[there]) > 2.0 * own.max()
        compared += is_other.sum()
        assert (errors(found[here], wanted[there]) > own[here])[is_other].all()
    assert compared > 0


def errors(a: NDArray[Any], b: NDArray[Any]) -> NDArray[np.float64]:
    """Return the mean squared difference of each frame, (K,)."""
    return np.mean((a.astype(np.float64) - b) ** 2, axis=(1, 2, 3))
