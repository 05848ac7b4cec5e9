"""The size of an image is read from its header, as decoders read it."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from grasp_factory.core.image_size import check_pixels, image_size
from grasp_factory.errors import LimitError

JPEG_WITH_PROGRESS = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 2)


def encoded(suffix: str, dtype: str, *settings: int) -> bytes:
    image = np.arange(37 * 23 * 3, dtype=dtype).reshape(37, 23, 3)
    return cv2.imencode(suffix, image, settings)[1].tobytes()


FILES = {
    "png": encoded(".png", "uint8"),
    "png of 16 bits": encoded(".png", "uint16"),
    "jpeg": encoded(".jpg", "uint8"),
    "progressive jpeg": encoded(".jpg", "uint8", *JPEG_WITH_PROGRESS),
    "bmp": encoded(".bmp", "uint8"),
    "tiff": encoded(".tif", "uint8"),
    "tiff of 16 bits": encoded(".tif", "uint16"),
}


@pytest.mark.parametrize("data", FILES.values(), ids=FILES)
def test_the_size_is_that_of_the_decoded_image(data: bytes) -> None:
    assert image_size(data) == (37, 23)


@pytest.mark.parametrize("data", FILES.values(), ids=FILES)
def test_bytes_that_are_cut_or_changed_are_no_image_or_have_a_size(data: bytes) -> None:
    rng = np.random.default_rng(0)
    for cut in range(min(len(data), 200)):
        changed = bytearray(data[: cut + 1])
        changed[rng.integers(len(changed))] = rng.integers(256)
        try:
            assert min(image_size(bytes(changed))) >= 1
        except ValueError as error:
            assert str(error) == "no PNG, JPEG, BMP or TIFF image"


@pytest.mark.parametrize("data", [b"", b"BM", b"GIF89a" + bytes(50), b"\xff\xd8" + b"\xff" * 50])
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match="no PNG, JPEG, BMP or TIFF image"):
        image_size(data)


def test_too_many_pixels_are_refused_unless_the_limit_is_raised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I4sII", 13, b"IHDR", 10_000, 6_401)
    with pytest.raises(LimitError, match="it: a number of pixels of 64,010,000, valid: up to 64,0"):
        check_pixels(data, "it")
    monkeypatch.setenv("GRASP_FACTORY_LIMITS", "pixels=65000000")
    check_pixels(data, "it")
