"""The renderers and the differences between them, as data; no library is loaded."""

from __future__ import annotations

from enum import Enum


class Renderer(Enum):
    """A renderer of images; ``docs/reference/rendering.md`` describes both."""

    TINY = "tiny"
    """PyBullet's TinyRenderer, on the CPU: it does not depend on a graphics driver."""
    EGL = "egl"
    """OpenGL without a window: on a GPU, or on the CPU with Mesa."""

    @property
    def pixel_offset(self) -> tuple[float, float]:
        """Sampling point (x, y) of pixel (0, 0), in pixels from the upper left corner of the image.

        OpenGL samples the centre of a pixel; the value for TinyRenderer is measured.
        """
        return (0.0, 1.0) if self is Renderer.TINY else (0.5, 0.5)

    @property
    def composites(self) -> bool:
        """Whether a pixel depends only on the nearest body, so that renders can be composed.

        With OpenGL it does not, because bodies cast shadows on each other.
        """
        return self is Renderer.TINY

    @property
    def has_textures(self) -> bool:
        """Whether textures are shown: PyBullet's OpenGL cannot add one to an existing body."""
        return self is Renderer.TINY

    @property
    def largest_image(self) -> tuple[int, int]:
        """Largest width and height in pixels; OpenGL scales up the image of its hidden window."""
        return (4096, 4096) if self is Renderer.TINY else (1024, 768)
