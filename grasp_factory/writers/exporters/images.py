"""Images as PNG files, and the choice of a camera, for formats that store images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.core.limits import CHUNK
from grasp_factory.core.place import Place
from grasp_factory.errors import lookup
from grasp_factory.writers.exporters.selection import Selection

PNG_LEVEL = 3
"""zlib level: at higher levels files are hardly smaller and take several times as long."""


def camera_of(episodes: Selection, name: str) -> str:
    """Return the camera that a setting names; the config's first one for an empty text.

    Raises:
        UnknownNameError: naming the cameras.
    """
    cameras = episodes.config.cameras
    if not name:
        return next(iter(cameras))
    lookup(cameras, "camera", name)
    return name


def write_png(path: Path, image: NDArray[Any]) -> None:
    """Write an image as PNG: RGB (H, W, 3) uint8, or one channel (H, W) uint8 or uint16.

    Raises:
        OSError: if it cannot be written.
    """
    path.write_bytes(png(image))


def png(image: NDArray[Any]) -> bytes:
    """Return an image as the bytes of a PNG file; see ``write_png``."""
    bgr = image[..., ::-1] if image.ndim == 3 else image
    _, data = cv2.imencode(
        ".png", np.ascontiguousarray(bgr), [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL]
    )
    return data.tobytes()


def read_png(place: Place, shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """Return the image of a PNG file that ``write_png`` wrote; see ``decode_png``.

    Raises:
        ValueError: if it is no image of this kind.
        OSError: if it cannot be read.
        LimitError: if it is too large.
    """
    return decode_png(place.read_bytes(CHUNK), place.name, shape, dtype)


def decode_png(data: bytes, name: str, shape: tuple[int, ...], dtype: str) -> NDArray[Any]:
    """Return the image of a PNG file that ``png`` made.

    Args:
        data: the bytes of the file.
        name: its name, for messages.
        shape: (H, W, 3) for RGB, or (H, W).
        dtype: uint8 or uint16.

    Raises:
        ValueError: if it is no image of this kind. The file's own size is compared before it is
            decoded: a small file may hold a large image.
    """
    size = tuple(int.from_bytes(data[at : at + 4], "big") for at in (20, 16))
    if not data.startswith(b"\x89PNG") or size != shape[:2]:
        raise ValueError(f"{name}: no PNG file of {shape[1]} x {shape[0]} pixels")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape != shape or image.dtype != dtype:
        raise ValueError(f"{name}: no image of {dtype} {shape}")
    return image[..., ::-1] if image.ndim == 3 else image


def depth_to_uint16(depth: Array | NDArray[np.float32], unit: float) -> NDArray[np.uint16]:
    """Return depth in metres as whole numbers of ``unit`` metres, rounded to the nearest.

    0 means that there is no value: for NaN, for 0 and for more than 65535 units.
    """
    units = np.rint(np.nan_to_num(depth.astype(np.float64), posinf=0.0, neginf=0.0) / unit)
    return np.where((units >= 0) & (units <= np.iinfo(np.uint16).max), units, 0).astype(np.uint16)
