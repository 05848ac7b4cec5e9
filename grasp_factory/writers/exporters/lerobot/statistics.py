"""Statistics of features, which LeRobot's policies normalize with; NaN is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array

_LEVELS = 256
"""Values of a colour channel; LeRobot's statistics of images are over values from 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameMoments:
    """Statistics of the values of some frames; those of several sets can be joined."""

    frames: int
    count: NDArray[np.int64]
    """Number of finite values of each element."""
    mean: Array
    squares: Array
    """Sum of the squared differences from the mean."""
    low: Array
    high: Array

    def with_those_of(self, other: FrameMoments) -> FrameMoments:
        """Return the moments of both sets together.

        https://en.wikipedia.org/wiki/Algorithms_for_calculating_variance#Parallel_algorithm
        """
        count = self.count + other.count
        share = other.count / np.maximum(count, 1)
        step = other.mean - self.mean
        return FrameMoments(
            frames=self.frames + other.frames,
            count=count,
            mean=self.mean + step * share,
            squares=self.squares + other.squares + step**2 * self.count * share,
            low=np.minimum(self.low, other.low),
            high=np.maximum(self.high, other.high),
        )

    def plain(self, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return LeRobot's statistics as lists of a shape; 0 where there is no value.

        Its ``count`` is the number of frames.
        """
        arrays = {
            "min": np.where(self.count > 0, self.low, 0.0),
            "max": np.where(self.count > 0, self.high, 0.0),
            "mean": self.mean,
            "std": np.sqrt(self.squares / np.maximum(self.count, 1)),
        }
        return {
            **{name: np.broadcast_to(array, shape).tolist() for name, array in arrays.items()},
            "count": [self.frames],
        }


def moments_of(values: NDArray[Any], per_frame: int = 1) -> FrameMoments:
    """Return the moments of the values of frames, (frames, ...).

    Args:
        values: the values.
        per_frame: records in a frame's window. If there are several, the second axis counts them,
            and the statistics are over all records.
    """
    frames = len(values)
    if per_frame > 1:
        values = values.reshape(-1, *values.shape[2:])
    numbers = values.astype(np.float64)
    finite = np.isfinite(numbers)
    count = finite.sum(axis=0)
    mean = np.where(finite, numbers, 0.0).sum(axis=0) / np.maximum(count, 1)
    return FrameMoments(
        frames=frames,
        count=count,
        mean=mean,
        squares=(np.where(finite, numbers - mean, 0.0) ** 2).sum(axis=0),
        low=np.where(finite, numbers, np.inf).min(axis=0),
        high=np.where(finite, numbers, -np.inf).max(axis=0),
    )


def moments_of_images(images: NDArray[np.uint8]) -> FrameMoments:
    """Return the moments of each channel, (3, 1, 1), of images (frames, H, W, 3)."""
    counts = np.zeros((3, _LEVELS))
    for image in images:
        for channel in range(3):
            counts[channel] += cv2.calcHist(
                [image], [channel], None, [_LEVELS], [0, _LEVELS]
            ).ravel()
    level = np.arange(_LEVELS) / (_LEVELS - 1)
    number = counts.sum(axis=1)
    mean = (counts * level).sum(axis=1) / number
    seen = counts > 0
    return FrameMoments(
        frames=len(images),
        count=_of_channels(number).astype(np.int64),
        mean=_of_channels(mean),
        squares=_of_channels((counts * (level - mean[:, None]) ** 2).sum(axis=1)),
        low=_of_channels(level[seen.argmax(axis=1)]),
        high=_of_channels(level[_LEVELS - 1 - seen[:, ::-1].argmax(axis=1)]),
    )


def _of_channels(values: Array) -> Array:
    return values.reshape(3, 1, 1)


def joined(
    first: Mapping[str, FrameMoments], second: Mapping[str, FrameMoments]
) -> dict[str, FrameMoments]:
    """Return the moments of two sets of frames together, by feature."""
    return {
        name: first[name].with_those_of(one) if name in first else one
        for name, one in second.items()
    }
