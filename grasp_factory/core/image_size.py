"""The size of an image in a file, read from its header: a small file may hold a large image.

PNG: https://www.w3.org/TR/png/#11IHDR, JPEG: ITU-T T.81, B.2.2, TIFF: revision 6.0, section 2,
BMP: the header that Windows calls BITMAPINFOHEADER.
"""

from __future__ import annotations

import struct

from grasp_factory.core.limits import PIXELS

_NO_FRAME = (0xC4, 0xC8, 0xCC)
"""Markers of JPEG among those of frames (0xC0 to 0xCF) that begin something else."""
_ALONE = (0x01, *range(0xD0, 0xD9))
"""Markers of JPEG without a length."""
_WIDTH, _HEIGHT = 256, 257
"""Tags of TIFF."""


def image_size(data: bytes) -> tuple[int, int]:
    """Return height and width of the image that a PNG, JPEG, BMP or TIFF file holds.

    Args:
        data: the bytes of the file.

    Raises:
        ValueError: if its header is of another format.
    """
    try:
        found = _found(data)
    except (struct.error, IndexError):
        found = None
    if found is None or min(found) < 1:
        raise ValueError("no PNG, JPEG, BMP or TIFF image")
    return found


def check_pixels(data: bytes, where: object) -> None:
    """Check the number of pixels of an image before it is decoded.

    Raises:
        LimitError: if there are too many.
        ValueError: see ``image_size``.
    """
    height, width = image_size(data)
    PIXELS.check(height * width, where)


def _found(data: bytes) -> tuple[int, int] | None:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        width, height = struct.unpack_from(">II", data, 16)
        return height, width
    if data.startswith(b"\xff\xd8"):
        return _jpeg(data)
    if data.startswith(b"BM"):
        width, height = struct.unpack_from("<ii", data, 18)
        return abs(height), width  # a negative height says that the first row is the top one
    if data.startswith((b"II*\0", b"MM\0*")):
        return _tiff(data, "<" if data.startswith(b"II") else ">")
    return None


def _jpeg(data: bytes) -> tuple[int, int] | None:
    place = 2
    while data[place] == 0xFF:
        marker = data[place + 1]
        if marker == 0xFF or marker in _ALONE:
            place += 1 if marker == 0xFF else 2
        elif 0xC0 <= marker <= 0xCF and marker not in _NO_FRAME:
            height, width = struct.unpack_from(">HH", data, place + 5)
            return height, width
        else:
            place += 2 + max(2, int.from_bytes(data[place + 2 : place + 4], "big"))
    return None


def _tiff(data: bytes, order: str) -> tuple[int, int] | None:
    (start,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, start)
    tags: dict[int, int] = {}
    for place in range(start + 2, start + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, place)
        (value,) = struct.unpack_from(f"{order}{'H' if kind == 3 else 'I'}", data, place + 8)
        tags[tag] = max(value, tags.get(tag, 0))
    return (tags[_HEIGHT], tags[_WIDTH]) if {_HEIGHT, _WIDTH} <= tags.keys() else None
