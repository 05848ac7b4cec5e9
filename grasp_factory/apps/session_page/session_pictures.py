"""The latest images of a session as JPEG files."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.capture.samples import CameraFrame, Payload, TactileReading
from grasp_factory.core.palette import NOTHING, depth_colors, force_colors, rgb

WIDEST = 640
"""Pixels of a picture on the page."""
_QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 75)


def picture(payload: Payload, kind: str) -> bytes | None:
    """Return an image of a sample as a JPEG file.

    Args:
        payload: the sample's.
        kind: rgb, depth or taxels.

    Returns:
        None if the sample has no such image.
    """
    if kind == "rgb" and isinstance(payload, CameraFrame):
        return _encoded(np.ascontiguousarray(payload.rgb[..., ::-1]))
    if kind == "depth" and isinstance(payload, CameraFrame) and payload.depth is not None:
        return _encoded(_coloured(payload.depth.astype(np.float64), depth_colors()))
    if kind == "taxels" and isinstance(payload, TactileReading):
        image = _coloured(np.asarray(payload.pressure, np.float64), force_colors())
        factor = max(1, 240 // max(image.shape[:2]))
        return _encoded(image.repeat(factor, axis=0).repeat(factor, axis=1))
    return None


def _coloured(values: NDArray[np.float64], colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return values (H, W) in colours (256, 3) between the ends, BGR; grey where 0 or NaN."""
    known = np.isfinite(values) & (values != 0.0)
    low, high = (values[known].min(), values[known].max()) if known.any() else (0.0, 1.0)
    scaled = np.where(known, (values - low) / max(high - low, 1e-12), 0.0)
    image = colors[(255.0 * scaled).astype(np.uint8)]
    shown = np.where(known[..., None], image, rgb(NOTHING)).astype(np.uint8)
    return np.ascontiguousarray(shown[..., ::-1])


def _encoded(image: NDArray[np.uint8]) -> bytes:
    height, width = image.shape[:2]
    if width > WIDEST:
        size = WIDEST, max(1, round(height * WIDEST / width))
        image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    ok, data = cv2.imencode(".jpg", image, _QUALITY)
    assert ok
    return bytes(data.tobytes())
