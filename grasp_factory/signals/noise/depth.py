"""A noise model for depth cameras that triangulate: structured light and stereo.

Convention: 0 where no depth is measured, as in the drivers of such cameras. The clean store has
``far`` where nothing is visible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.signals.noise.number_checks import check_figures
from grasp_factory.signals.noise.occlusion import DepthImage, bends, incidence, shadow

_DEGREE = math.pi / 180.0
_NEAREST = 1e-3
"""Metres; noisy depths are at least this large, so that the disparity is finite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthNoise:
    """The imperfections of a depth camera.

    Pixels are those of the sensor; for an image with another focal length they are scaled in
    proportion.
    """

    focal_length: float
    """Pixels."""
    baseline: float
    """Metres from the camera to the projector or second camera, along +x of the image."""
    axial_floor: float
    """Metres; see ``sigma`` for this and the next three."""
    axial_growth: float
    """1/m."""
    axial_origin: float
    """Metres."""
    axial_grazing: float
    """m^1.5."""
    correlation: float
    """Pixels: standard deviation of the Gaussian that smooths the axial noise over the image."""
    lateral: float
    """Pixels: standard deviation, in u and in v, of the shift of a pixel next to an edge."""
    disparity_step: float
    """Pixels of disparity per count; 0 for no quantisation."""
    edge_bend: float
    """Pixels: an edge is where the disparity's second difference exceeds this."""
    edge_loss: float
    """Share of the pixels next to an edge that measure nothing."""
    grazing_loss: tuple[float, float]
    """Incidence angles, rad: up to the first no pixel is lost, from the second on all are lost, and
    between them the share is linear."""
    reach: tuple[float, float]
    """Metres: nothing is measured nearer than the first or farther than the second."""

    def __post_init__(self) -> None:
        """Check the figures (``check_figures``)."""
        check_figures(self)

    def sigma(self, z: ArrayLike, theta: ArrayLike = 0.0) -> Array:
        """Return the standard deviation of measured depth, metres, quantisation included.

        It is ``floor + growth (z - origin)^2 + grazing / sqrt(z) (theta / (pi/2 - theta))^2``, the
        form of Nguyen, Izadi & Lovell 2012. With ``growth`` alone and the other three 0, it is the
        law of any stereo camera, ``z^2 subpixel / (f B)``.

        Args:
            z: Depth, metres.
            theta: Angle between the surface's normal and the line of sight, rad, below pi/2.
        """
        z, theta = np.asarray(z), np.asarray(theta)
        steep = (theta / (math.pi / 2.0 - theta)) ** 2
        level = self.axial_floor + self.axial_growth * (z - self.axial_origin) ** 2
        return np.asarray(level + self.axial_grazing / np.sqrt(z) * steep)

    def count(self, z: ArrayLike) -> Array:
        """Return the difference in depth between two counts of disparity at a depth, metres."""
        return np.asarray(z) ** 2 * self.disparity_step / (self.focal_length * self.baseline)


STRUCTURED_LIGHT = DepthNoise(
    # Kinect for Xbox 360. Khoshelham & Elberink 2012 ("Accuracy and Resolution of Kinect Depth
    # Data", Sensors 12(2)): f = 5.453 mm at 9.3 um per pixel, baseline 75 mm, range 0.5 to 5 m.
    focal_length=586.0,
    baseline=0.075,
    reach=(0.5, 5.0),
    # Their depth resolution, 2.85e-5 z^2 cm, corresponds to steps of 1/8 pixel.
    disparity_step=0.125,
    # Nguyen, Izadi & Lovell 2012 ("Modeling Kinect Sensor Noise", 3DIMPVT): axial and lateral.
    axial_floor=0.0012,
    axial_growth=0.0019,
    axial_origin=0.4,
    axial_grazing=0.0001,
    lateral=0.8,
    # Assumptions: no source states figures for these.
    correlation=0.0,
    edge_bend=1.0,
    edge_loss=0.5,
    grazing_loss=(75.0 * _DEGREE, 85.0 * _DEGREE),
)
"""Like a Kinect for Xbox 360."""

# Intel, "Tuning depth cameras for best performance" (RealSense documentation): D435 at 848x480 with
# 90 degrees across, so f = 424 pixels; 50 mm; a subpixel RMS of 0.08 pixel, as in its figure. The
# matcher searches 126 disparities.
_D435_FOCAL, _D435_BASELINE, _D435_SUBPIXEL, _D435_SEARCH = 424.0, 0.050, 0.08, 126

STEREO = DepthNoise(
    focal_length=_D435_FOCAL,
    baseline=_D435_BASELINE,
    axial_floor=0.0,
    axial_growth=_D435_SUBPIXEL / (_D435_FOCAL * _D435_BASELINE),
    axial_origin=0.0,
    axial_grazing=0.0,
    # Datasheet of the D400 series: up to 10 m.
    reach=(_D435_FOCAL * _D435_BASELINE / _D435_SEARCH, 10.0),
    # Intel, "Subpixel linearity improvement": disparities resolved to 1/32 pixel.
    disparity_step=1.0 / 32.0,
    # Assumptions: a matcher compares windows, so its errors are smooth and its edges irregular.
    correlation=2.0,
    lateral=1.0,
    edge_bend=1.0,
    edge_loss=0.5,
    grazing_loss=(75.0 * _DEGREE, 85.0 * _DEGREE),
)
"""Like an Intel RealSense D435 on a well-textured scene."""


def corrupt(
    noise: DepthNoise,
    depth: ArrayLike,
    K: Array,
    far: float,
    seed: int | np.random.SeedSequence,
) -> DepthImage:
    """Return a depth image as a triangulating camera would have measured it.

    A pixel next to a depth edge takes the depth of a pixel nearby. Then axial noise is added and
    the disparity is rounded. Nothing is measured out of reach, in the shadow of the projector
    (second camera), at grazing angles and at some pixels next to edges.

    The measured sigma of Nguyen et al. includes the quantisation, so the added noise has the
    remaining variance: ``sigma^2 - count^2 / 12``. The lateral noise is also theirs, measured at
    edges. On a slanted surface their axial figures already include its effect, so it is not added
    twice.

    Args:
        noise: The camera, e.g. ``STEREO``.
        depth: (H, W) metres along the optical axis, without noise.
        K: (3, 3) pixels.
        far: Far plane, metres: at this depth or more, nothing is visible.
        seed: The same seed yields the same image.

    Returns:
        (H, W) metres, 0 where nothing was measured.
    """
    rng = np.random.default_rng(seed)
    z = np.asarray(depth, np.float32)
    pixels = float(K[0, 0]) / noise.focal_length
    normal = _field(rng, z.shape, noise.correlation * pixels)
    # Slightly below far, which the z-buffer does not represent exactly.
    seen = (z > 0.0) & (z < far * (1.0 - 1e-4))
    inverse = np.divide(1.0, z, out=np.full_like(z, 1.0 / far), where=seen)
    focal_baseline = noise.focal_length * noise.baseline

    spread = noise.lateral * pixels
    edge = bends(inverse) * focal_baseline > noise.edge_bend
    around = max(1, round(2.0 * spread))
    near_edge = cv2.dilate(edge.view(np.uint8), np.ones((3, 3)), iterations=around)
    beside = np.nonzero(near_edge)
    looks_at = _aside(rng, beside, spread, z.shape)
    theta = incidence(inverse, K)
    lost = shadow(inverse, float(K[0, 0]) * noise.baseline)

    first, last = noise.grazing_loss
    chance = np.clip((theta - first) / np.float32(max(last - first, 1e-9)), 0.0, 1.0)
    chance[beside] = np.maximum(chance[beside], noise.edge_loss)
    lost |= rng.random(z.shape, np.float32) < chance

    inverse[beside], seen[beside] = inverse[looks_at], seen[looks_at]
    seen_z = np.asarray(1.0 / inverse, np.float32)
    lost |= ~seen | (seen_z < noise.reach[0]) | (seen_z > noise.reach[1])
    # Lost pixels must not cause a division by zero.
    measured = _measure(noise, seen_z, np.minimum(theta, np.float32(min(last, 1.57))), normal)
    return np.where(lost, np.float32(0.0), measured)


def _measure(noise: DepthNoise, z: DepthImage, theta: DepthImage, normal: DepthImage) -> DepthImage:
    """Return depths (H, W) with axial noise, rounded to counts of disparity.

    ``normal`` is unit normal noise, which is scaled here.
    """
    white = noise.sigma(z, theta) ** 2 - noise.count(z) ** 2 / 12.0
    measured = z + normal * np.sqrt(np.maximum(white, 0.0))
    if noise.disparity_step:
        scale = noise.focal_length * noise.baseline / noise.disparity_step
        counts = np.rint(scale / np.maximum(measured, _NEAREST))
        measured = scale / np.maximum(counts, 1.0)
    return np.asarray(measured, np.float32)


def _field(rng: np.random.Generator, shape: tuple[int, ...], smoothing: float) -> DepthImage:
    """Return unit normal noise (H, W), smoothed by a Gaussian of ``smoothing`` pixels."""
    r = math.ceil(3.0 * smoothing)
    height, width = shape
    white = rng.standard_normal((height + 2 * r, width + 2 * r), np.float32)
    if not r:
        return white
    k = cv2.getGaussianKernel(2 * r + 1, smoothing, cv2.CV_32F)
    smooth = cv2.sepFilter2D(white, -1, k, k)[r : r + height, r : r + width]
    return np.asarray(smooth / np.float32((k**2).sum()), np.float32)


def _aside(
    rng: np.random.Generator,
    beside: tuple[NDArray[np.intp], ...],
    spread: float,
    shape: tuple[int, ...],
) -> tuple[NDArray[np.intp], ...]:
    """Return the pixels, rows and columns, whose depth some pixels take instead of their own."""
    moves = np.rint(spread * rng.standard_normal((2, len(beside[0])))).astype(np.intp)
    pairs = zip(beside, moves, shape, strict=True)
    return tuple(np.clip(at + move, 0, size - 1) for at, move, size in pairs)
