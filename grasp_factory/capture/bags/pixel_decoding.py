"""Images of sensor_msgs as arrays.

Encodings: https://github.com/ros2/common_interfaces, ``sensor_msgs/image_encodings.hpp``;
compressed images: https://github.com/ros-perception/image_transport_plugins.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.image_size import check_pixels
from grasp_factory.errors import shown
from grasp_factory.writers.exporters.images import depth_to_uint16

MM = 1e-3
"""Unit of depth images, m: that of 16UC1, https://www.ros.org/reps/rep-0118.html"""
_DEPTH_HEADER = struct.Struct("<iff")
"""Of compressedDepth: a format, and both parameters of the quantization."""
_MAX_SIDE = 32768


@dataclass(frozen=True, slots=True, kw_only=True)
class DecodedImage:
    """An image."""

    values: NDArray[Any]
    """RGB (H, W, 3) uint8, grey (H, W) uint8 or uint16, or depth (H, W) uint16, mm."""
    is_depth: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Encoding:
    """How an image's bytes are read."""

    dtype: str
    channels: int
    convert: Callable[[NDArray[Any]], NDArray[Any]]
    """Returns the values from an array (H, W, channels)."""
    is_depth: bool = False


def _channels(*order: int) -> Callable[[NDArray[Any]], NDArray[Any]]:
    return lambda image: image[..., order]


def _first(image: NDArray[Any]) -> NDArray[Any]:
    return image[..., 0]


def _colour_conversion(code: int) -> Callable[[NDArray[Any]], NDArray[Any]]:
    return lambda image: cv2.cvtColor(np.ascontiguousarray(image), code)


def _metres(image: NDArray[Any]) -> NDArray[Any]:
    return depth_to_uint16(image[..., 0], MM)


_RGB, _BGR = _channels(0, 1, 2), _channels(2, 1, 0)
ENCODINGS: Mapping[str, Encoding] = {
    "rgb8": Encoding(dtype="u1", channels=3, convert=_RGB),
    "bgr8": Encoding(dtype="u1", channels=3, convert=_BGR),
    "rgba8": Encoding(dtype="u1", channels=4, convert=_RGB),
    "bgra8": Encoding(dtype="u1", channels=4, convert=_BGR),
    "8UC3": Encoding(dtype="u1", channels=3, convert=_BGR),
    "8UC4": Encoding(dtype="u1", channels=4, convert=_BGR),
    "mono8": Encoding(dtype="u1", channels=1, convert=_first),
    "8UC1": Encoding(dtype="u1", channels=1, convert=_first),
    "mono16": Encoding(dtype="u2", channels=1, convert=_first),
    "16UC1": Encoding(dtype="u2", channels=1, convert=_first, is_depth=True),
    "32FC1": Encoding(dtype="f4", channels=1, convert=_metres, is_depth=True),
    # OpenCV names a Bayer pattern by its second row.
    **{
        f"bayer_{name}8": Encoding(dtype="u1", channels=1, convert=_colour_conversion(code))
        for name, code in (
            ("rggb", cv2.COLOR_BayerBG2RGB),
            ("bggr", cv2.COLOR_BayerRG2RGB),
            ("gbrg", cv2.COLOR_BayerGR2RGB),
            ("grbg", cv2.COLOR_BayerGB2RGB),
        )
    },
    **{
        name: Encoding(dtype="u1", channels=2, convert=_colour_conversion(code))
        for name, code in (
            ("yuv422", cv2.COLOR_YUV2RGB_UYVY),
            ("uyvy", cv2.COLOR_YUV2RGB_UYVY),
            ("yuv422_yuy2", cv2.COLOR_YUV2RGB_YUY2),
            ("yuyv", cv2.COLOR_YUV2RGB_YUY2),
        )
    },
}


def decode_image(message: Any) -> DecodedImage:
    """Return the image of a sensor_msgs/Image, whose rows may be padded.

    Raises:
        ValueError: if it cannot be decoded, saying why.
    """
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        raise ValueError(f"encoding {shown(message.encoding)}, valid: {', '.join(ENCODINGS)}")
    height, width, step = int(message.height), int(message.width), int(message.step)
    dtype = np.dtype(encoding.dtype).newbyteorder(">" if message.is_bigendian else "<")
    row = width * encoding.channels * dtype.itemsize
    if not (0 < height <= _MAX_SIDE and 0 < width <= _MAX_SIDE and row <= step):
        raise ValueError(f"{width} x {height} pixels of {message.encoding} in rows of {step} bytes")
    data = np.asarray(message.data, np.uint8)
    if data.size < height * step:
        raise ValueError(f"{data.size} bytes, where {height} rows of {step} should be")
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    image = rows.view(dtype).reshape(height, width, encoding.channels)
    try:
        values = encoding.convert(image.astype(dtype.newbyteorder("=")))
    except cv2.error:
        raise ValueError(f"{width} x {height} pixels of {message.encoding}") from None
    return DecodedImage(values=values, is_depth=encoding.is_depth)


def decode_compressed_image(message: Any) -> DecodedImage:
    """Return the image of a sensor_msgs/CompressedImage.

    Raises:
        ValueError: if it cannot be decoded, saying why.
    """
    kind, data = message.format, np.asarray(message.data, np.uint8)
    if "compressedDepth" in kind:
        return DecodedImage(values=_compressed_depth(kind, data), is_depth=True)
    if kind.startswith("16UC1"):
        return DecodedImage(values=_one_channel(_pixels(data, kind)), is_depth=True)
    image = _pixels(data, kind)
    is_grey = image.ndim == 2
    values = image if is_grey else image[..., 2::-1]
    if values.dtype != np.uint8 and not (is_grey and values.dtype == np.uint16):
        raise ValueError(f"format {shown(kind)} with pixels of {values.dtype}")
    return DecodedImage(values=values, is_depth=False)


def _compressed_depth(kind: str, data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Return depth, mm; 32FC1 is stored as quantized inverse depth."""
    if "rvl" in kind.lower():
        raise ValueError(f"format {shown(kind)}, valid: PNG")
    if data.size < _DEPTH_HEADER.size:
        raise ValueError(f"{data.size} bytes are no compressed depth image")
    _, a, b = _DEPTH_HEADER.unpack_from(data.tobytes()[: _DEPTH_HEADER.size])
    values = _one_channel(_pixels(data[_DEPTH_HEADER.size :], kind))
    if not kind.startswith("32FC1"):
        return values
    with np.errstate(all="ignore"):
        depth = np.where(values > 0, a / (values.astype(np.float64) - b), 0.0)
    return depth_to_uint16(depth, MM)


def _pixels(data: NDArray[np.uint8], kind: str) -> NDArray[Any]:
    """Return the pixels of a PNG, JPEG or TIFF file, (H, W) or BGR(A) (H, W, channels)."""
    try:
        check_pixels(data.tobytes(), f"format {shown(kind)}")
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except (cv2.error, ValueError):
        image = None
    if image is None:
        raise ValueError(f"format {shown(kind)}: the data are no image that OpenCV can read")
    return image


def _one_channel(image: NDArray[Any]) -> NDArray[np.uint16]:
    if image.ndim != 2 or image.dtype != np.uint16:
        raise ValueError(f"a depth image of {image.dtype} with shape {image.shape}")
    return image
