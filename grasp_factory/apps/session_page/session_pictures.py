"""The latest images of a session as JPEG files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.pictures.small_jpeg import small_jpeg
from grasp_factory.capture.samples import CameraFrame, Payload, TactileReading
from grasp_factory.core.palette import NOTHING, depth_colors, force_colors, rgb

WIDEST = 640
"""Pixels of a picture on the page."""
_QUALITY = 75


def picture(payload: Payload, kind: str) -> bytes | None:
    """Return an image of a sample as a JPEG file.

    Args:
        payload: the sample's.
        kind: rgb, depth or taxels.

    Returns:
        None if the sample has no such image.
    """
    image = _image(payload, kind)
    return None if image is None else small_jpeg(image, WIDEST, _QUALITY)


def _image(payload: Payload, kind: str) -> BgrImage | None:
    if kind == "rgb" and isinstance(payload, CameraFrame):
        return np.ascontiguousarray(payload.rgb[..., ::-1])
    if kind == "depth" and isinstance(payload, CameraFrame) and payload.depth is not None:
        return _coloured(payload.depth.astype(np.float64), depth_colors())
    if kind == "taxels" and isinstance(payload, TactileReading):
        image = _coloured(np.asarray(payload.pressure, np.float64), force_colors())
        factor = max(1, 240 // max(image.shape[:2]))
        return image.repeat(factor, axis=0).repeat(factor, axis=1)
    return None


def _coloured(values: NDArray[np.float64], colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return values (H, W) in colours (256, 3) between the ends, BGR; grey where 0 or NaN."""
    known = np.isfinite(values) & (values != 0.0)
    low, high = (values[known].min(), values[known].max()) if known.any() else (0.0, 1.0)
    scaled = np.where(known, (values - low) / max(high - low, 1e-12), 0.0)
    image = colors[(255.0 * scaled).astype(np.uint8)]
    shown = np.where(known[..., None], image, rgb(NOTHING)).astype(np.uint8)
    return np.ascontiguousarray(shown[..., ::-1])
