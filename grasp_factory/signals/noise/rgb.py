"""A noise model for color cameras: blur, shot noise, read noise, white balance, JPEG.

Light adds up linearly, so all steps but JPEG work in linear light: images are assumed to be sRGB
(IEC 61966-2-1). They are decoded, noise is added, and they are encoded again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals.noise.number_checks import check_figures

RgbImage = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True)
class RgbNoise:
    """The imperfections of a color camera."""

    full_well: float
    """Electrons at the brightest value; 0 for no shot noise and no read noise."""
    read_noise: float
    """Electrons, standard deviation."""
    white_balance: float = 0.0
    """Standard deviation of the logarithm of the gains of red and blue, drawn for each image."""
    blur_length: float = 0.0
    """Pixels that the image moves during the exposure."""
    blur_angle: float | None = None
    """Rad from +u to +v; None draws a direction for each image."""
    jpeg_quality: int | None = None
    """1 to 100, as in OpenCV; None for no compression."""

    def __post_init__(self) -> None:
        """Check the figures.

        Raises:
            UsageError: naming the figure.
        """
        check_figures(self)
        if self.jpeg_quality is not None and not 1 <= self.jpeg_quality <= 100:
            raise UsageError(f"RgbNoise: jpeg_quality {self.jpeg_quality}: valid: 1 to 100 or None")

    def sigma(self, light: ArrayLike) -> Array:
        """Return the standard deviation of linear light, which is 0 to 1, in the same unit.

        This is the linear camera model of EMVA Standard 1288: the variance of shot noise is the
        number of electrons, and read noise adds its own variance.
        """
        electrons = self.full_well * np.asarray(light)
        return np.asarray(np.sqrt(electrons + self.read_noise**2) / self.full_well)


SMALL_PIXELS = RgbNoise(
    # Assumptions, typical of cameras with pixels of 1 to 3 um indoors: a full well of 5000
    # electrons has a noise of 1.4 % at white; the read noise of 5 electrons includes the gain.
    full_well=5000.0,
    read_noise=5.0,
    white_balance=0.02,
    jpeg_quality=90,
    # The cameras see the scene at rest, before and after the attempt: there is no blur.
    blur_length=0.0,
)
"""Like the color camera next to a depth sensor."""


def corrupt(noise: RgbNoise, rgb: RgbImage, seed: int | np.random.SeedSequence) -> RgbImage:
    """Return an image as a noisy camera would have taken it.

    The order is: motion blur, shot and read noise, white balance, the eight bits of sRGB, JPEG.
    Shot noise is drawn from a normal distribution: below about ten electrons it lacks the skew of
    the Poisson distribution.

    Args:
        noise: The camera, e.g. ``SMALL_PIXELS``.
        rgb: (H, W, 3) sRGB.
        seed: The same seed yields the same image.

    Returns:
        (H, W, 3) sRGB.
    """
    rng = np.random.default_rng(seed)
    gains = np.exp(noise.white_balance * rng.standard_normal(3)).astype(np.float32)
    gains[1] = 1.0  # red and blue are balanced against green
    angle = noise.blur_angle
    if angle is None:
        angle = rng.uniform(0.0, math.pi)
    light: NDArray[Any] = _DECODED[rgb]
    if noise.blur_length:
        light = cv2.filter2D(light, -1, streak(noise.blur_length, angle))
    if noise.full_well:
        spread = np.sqrt((light + noise.read_noise**2 / noise.full_well) / noise.full_well)
        light = light + spread.astype(np.float32) * rng.standard_normal(rgb.shape, np.float32)
    steps = len(_ENCODED) - 1
    image = _ENCODED[(np.clip(light * gains, 0.0, 1.0) * steps + 0.5).astype(np.uint16)]
    return image if noise.jpeg_quality is None else _jpeg(image, noise.jpeg_quality)


def srgb_to_linear(value: ArrayLike) -> Array:
    """Return linear light for sRGB values, both 0 to 1 (IEC 61966-2-1)."""
    value = np.asarray(value, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: ArrayLike) -> Array:
    """Return sRGB values for linear light, both 0 to 1 (IEC 61966-2-1)."""
    light = np.asarray(light, np.float64)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def streak(length: float, angle: float) -> NDArray[np.float32]:
    """Return the blur kernel of uniform motion along a straight line, (2 r + 1, 2 r + 1).

    Points along the line share their weight among the four pixels around them; the sum is 1.

    Args:
        length: Pixels.
        angle: Rad from +u to +v.
    """
    r = math.ceil(length / 2.0) + 1
    along = np.linspace(-length / 2.0, length / 2.0, 16 * r)
    kernel = np.zeros((2 * r + 1, 2 * r + 1))
    u, v = r + along * math.cos(angle), r + along * math.sin(angle)
    i, j = np.floor(v).astype(int), np.floor(u).astype(int)
    for di in (0, 1):
        for dj in (0, 1):
            weight = (1.0 - np.abs(v - i - di)) * (1.0 - np.abs(u - j - dj))
            np.add.at(kernel, (i + di, j + dj), weight / len(along))
    return kernel.astype(np.float32)


def _jpeg(rgb: RgbImage, quality: int) -> RgbImage:
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), flags)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)  # type: ignore[arg-type]


_DECODED = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)
# Even at black, where sRGB is steepest, a step of this table is a twentieth of an eight-bit one.
_ENCODED = np.round(255.0 * linear_to_srgb(np.arange(2**16) / (2**16 - 1))).astype(np.uint8)
