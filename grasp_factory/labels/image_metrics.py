"""The measurements behind a quality score.

They are taken from the stored arrays of an episode, so that anyone can repeat them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import Array
from grasp_factory.core.sensors import series_groups
from grasp_factory.labels.force_balance import force_residual

LUMA = np.array([[0.299, 0.587, 0.114]])
"""Weights of red, green and blue in a grey value (ITU-R BT.601)."""
CLIPPED = 4
"""Grey values this close to 0 or 255 count as black or white."""
MID_GREY = 0.5
FAR_ROUNDING = 1e-6
"""Relative: pixels without a surface have the depth ``far``, up to this rounding error."""
BEFORE = 0
"""The frame before the attempt."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Inspection:
    """Quality measurements of one episode; the columns of the same names define them."""

    sharpness: float
    exposure: float
    clipped: float
    target_visibility: float
    target_pixels: float
    depth_holes: float
    stream_gap: float
    """NaN without records."""
    force_residual: float
    """NaN without a hold."""


def inspect_episode(episode: Episode) -> Inspection:
    """Measure an episode, simulated or read from a store, with noise or without.

    For sharpness, exposure, clipping and holes, the worst camera counts, because all images are
    stored. For the target's visibility and pixels, the best camera counts, because one camera that
    sees the target is enough.
    """
    spec, cameras = episode.spec, episode.cameras
    greys = [grey(frames.rgb[BEFORE]) for frames in cameras.values()]
    light = [exposure(image) for image in greys]
    return Inspection(
        sharpness=min(map(sharpness, greys)),
        exposure=max((mean for mean, _ in light), key=lambda mean: abs(mean - MID_GREY)),
        clipped=max(clipped for _, clipped in light),
        target_visibility=max(float(f.visibility[BEFORE, 0]) for f in cameras.values()),
        target_pixels=float(max(map(_target_pixels, cameras.values()))),
        depth_holes=max(
            depth_holes(frames.depth[BEFORE], spec.cameras[name].far)
            for name, frames in cameras.items()
        ),
        stream_gap=longest_gap(_series(episode)),
        force_residual=force_residual(
            episode.streams,
            np.asarray(episode.columns["object_com"])[0],
            float(episode.columns["object_mass"]),
            spec.physics.gravity,
        ),
    )


def grey(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the grey values (H, W) of an image (H, W, 3)."""
    return np.asarray(cv2.transform(rgb, LUMA), np.uint8).reshape(rgb.shape[:2])


def sharpness(image: NDArray[np.uint8]) -> float:
    """Return the share of the Laplacian's variance that a mean over 3 x 3 pixels takes away.

    It is near 1 for edges that are one pixel wide, and near 0 for wide edges or an image without
    edges. The plain variance would depend more on the content of the image.

    Args:
        image: Grey values (H, W).
    """
    before = _laplacian_variance(image)
    if before == 0.0:
        return 0.0
    # Rounded to 8 bits like the image, so that rounding steps do not count as edges.
    blurred = np.asarray(cv2.blur(image, (3, 3)), np.uint8)
    return max(0.0, 1.0 - _laplacian_variance(blurred) / before)


def exposure(image: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the mean grey value, 0 to 1, and the share of pixels that are black or white.

    Args:
        image: Grey values (H, W).
    """
    clipped = np.count_nonzero((image <= CLIPPED) | (image >= 255 - CLIPPED))
    return int(image.sum(dtype=np.int64)) / image.size / 255.0, int(clipped) / image.size


def depth_holes(depth: NDArray[np.float32], far: float) -> float:
    """Return the share of pixels without a depth above 0 and below ``far``.

    Args:
        depth: (H, W) metres.
        far: End of the camera's range, metres.
    """
    seen = (depth > 0.0) & (depth < far * (1.0 - FAR_ROUNDING))
    return 1.0 - int(np.count_nonzero(seen)) / depth.size


def longest_gap(series: Iterable[tuple[Array, float]]) -> float:
    """Return the longest time without a record, in periods of its series.

    The times before the first record of a series and after its last one, up to the last record of
    all series, count as well. Infinite for timestamps that do not increase, NaN without records.

    Args:
        series: For each series, its timestamps (n,) in seconds and its rate in Hz.
    """
    clocks = [(np.asarray(times, np.float64), rate) for times, rate in series]
    end = max((float(times[-1]) for times, _ in clocks if len(times)), default=math.nan)
    if any(not (np.diff(times, prepend=0.0) > 0.0).all() for times, _ in clocks):
        return math.inf
    gaps = [float(np.diff(times, prepend=0.0, append=end).max()) * rate for times, rate in clocks]
    return max(gaps, default=math.nan)


def _laplacian_variance(image: NDArray[np.uint8]) -> float:
    """Return the variance of the Laplacian over eight neighbours, from exact sums."""
    # Unlike cv2.Laplacian, this starts no threads in each worker.
    around = cv2.boxFilter(image, cv2.CV_16S, (3, 3), normalize=False)
    deviation = float(cv2.meanStdDev(around - np.int16(9) * image)[1].item())
    return deviation * deviation


def _target_pixels(frames: CameraFrames) -> int:
    return int(np.count_nonzero(frames.segmentation[BEFORE] == Label.TARGET))


def _series(episode: Episode) -> list[tuple[Array, float]]:
    rates = {group.name: group.rate(episode.spec) for group in series_groups()}
    return [(arrays["timestamp"], rates[name]) for name, arrays in episode.series.items()]
