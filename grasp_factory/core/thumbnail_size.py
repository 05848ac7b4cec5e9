"""The size of a small picture of an image that may be very thin."""

from __future__ import annotations

_MOST = 2
"""A picture is at most so many times as high as wide."""


def thumbnail_height(width: int, image: tuple[int, ...]) -> int:
    """Return the height of a picture that is ``width`` pixels wide.

    It has the proportions of the image, unless that is more than twice as high as wide: then the
    picture is twice as high as wide, because one with the proportions may need gigabytes.

    Args:
        width: pixels.
        image: height and width of the image, pixels; more numbers, as of a shape, may follow.
    """
    return min(max(1, round(width * image[0] / image[1])), _MOST * width)
