"""Measures of a camera's images, taken one image after the other."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.quality.noisy_sharpness import noisy_sharpness
from grasp_factory.labels.image_metrics import exposure, grey

EVERY = 5
"""Sharpness and exposure are measured in every fifth image."""


@dataclass(slots=True)
class ImageMeasures:
    """Collects the measures of one camera."""

    images: int = 0
    frozen: int = 0
    """Longest run of images that repeat the one before them."""
    sharpness: list[float] = field(default_factory=list)
    exposure: list[float] = field(default_factory=list)
    clipped: list[float] = field(default_factory=list)
    _before: NDArray[np.uint8] | None = None
    _run: int = 0

    def add(self, rgb: NDArray[np.uint8]) -> None:
        """Add the next image (H, W, 3)."""
        is_same = self._before is not None and np.array_equal(self._before, rgb)
        self._run = self._run + 1 if is_same else 0
        self.frozen = max(self.frozen, self._run)
        self._before = rgb
        if self.images % EVERY == 0:
            values = grey(rgb)
            mean, clipped = exposure(values)
            self.sharpness.append(noisy_sharpness(values))
            self.exposure.append(mean)
            self.clipped.append(clipped)
        self.images += 1


def median(values: list[float]) -> float:
    """Return the median; NaN without values."""
    return float(np.median(values)) if values else math.nan
