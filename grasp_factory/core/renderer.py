"""What can draw images, and what each of them does otherwise. Loads no library."""

from __future__ import annotations

from enum import Enum


class Renderer(Enum):
    """What draws the images; ``docs/reference/rendering.md`` says what each promises."""

    TINY = "tiny"
    """PyBullet's own, on the CPU: no driver has a part in it."""
    EGL = "egl"
    """OpenGL without a window: on a GPU, or on the CPU by Mesa."""

    @property
    def pixel_offset(self) -> tuple[float, float]:
        """Where pixel (0, 0) is sampled, in pixels from the image's upper left corner.

        OpenGL samples in the middle of a pixel; TinyRenderer where this says (measured).
        """
        return (0.0, 1.0) if self is Renderer.TINY else (0.5, 0.5)

    @property
    def composites(self) -> bool:
        """Whether a pixel is that of the nearest body alone, whatever else there is.

        With OpenGL, bodies cast shadows on each other.
        """
        return self is Renderer.TINY

    @property
    def has_textures(self) -> bool:
        """Whether textures are shown: PyBullet's OpenGL puts none on a body that is there."""
        return self is Renderer.TINY

    @property
    def largest_image(self) -> tuple[int, int]:
        """The most pixels of width and height: OpenGL enlarges those of its hidden window."""
        return (4096, 4096) if self is Renderer.TINY else (1024, 768)
