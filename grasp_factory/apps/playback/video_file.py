"""Videos as files: MP4 and GIF, written with OpenCV."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.core.mp4_file import mp4_file
from grasp_factory.core.output_file import FileKind, check_out
from grasp_factory.errors import UsageError

MP4 = FileKind(what="an MP4 video", suffix=".mp4", magic=b"ftyp", offset=4)
GIF = FileKind(what="a GIF animation", suffix=".gif", magic=b"GIF8")
KINDS = (MP4, GIF)
FASTEST_GIF = 50
"""Frames per second: viewers show faster GIFs at only ten."""
GIF_COLORS = (cv2.IMWRITE_GIF_DITHER, 3)
"""A separate palette for each frame: a tenth of the error of OpenCV's default, and a third of the
bytes."""
LARGEST_GIF = 2**30
"""Maximum bytes of all frames, which are in memory until the file is written."""


class FrameSink(Protocol):
    """Receives the frames of a video, one after the other."""

    def add(self, image: BgrImage) -> None:
        """Append a frame, BGR (height, width, 3)."""


@contextlib.contextmanager
def frame_sink(path: Path, size: tuple[int, int], fps: float) -> Iterator[FrameSink]:
    """Yield a sink for the frames of a video; the file is complete when the block ends.

    Args:
        path: A file ending in .mp4 or .gif, which is overwritten.
        size: Width and height of each frame, pixels. MP4 needs even sizes: an odd size
            becomes one pixel larger, and the last row or column is repeated.
        fps: Frames per second; see ``nearest_fps``.

    Raises:
        OSError: if it cannot be written.
    """
    if path.suffix.lower() == MP4.suffix:
        with mp4_file(path, size, fps) as sink:
            yield sink
        return
    animation = _Gif()
    yield animation
    animation.write(path, fps)


def nearest_fps(path: Path, fps: float) -> float:
    """Return the rate nearest to ``fps`` that a file can have: GIFs count in hundredths of seconds.

    Raises:
        UsageError: if a video may not be written to ``path``.
    """
    return fps if check_out(path, KINDS) is MP4 else 100.0 / max(1, round(100.0 / fps))


def check_video(path: Path, size: tuple[int, int], fps: float, frames: int) -> None:
    """Check that a video with this number of frames can be written to ``path``.

    Raises:
        UsageError: if a video may not be written there, or a GIF would be too large or too fast.
    """
    if check_out(path, KINDS) is MP4:
        return
    if fps > FASTEST_GIF:
        raise UsageError(f"{fps:g} frames per second: of a GIF, valid: up to {FASTEST_GIF}")
    if (needed := frames * size[0] * size[1] * 3) > LARGEST_GIF:
        raise UsageError(
            f"a GIF of {frames} frames with {size[0]}x{size[1]} pixels needs {needed / 1e9:.1f} GB"
            " of memory: take fewer frames, a smaller --resolution, or a name that ends in .mp4"
        )


class _Gif:
    """A GIF file, which OpenCV writes in one call."""

    def __init__(self) -> None:
        self._frames: list[BgrImage] = []

    def add(self, image: BgrImage) -> None:
        """Append a frame."""
        self._frames.append(np.ascontiguousarray(image))

    def write(self, path: Path, fps: float) -> None:
        """Write the file."""
        animation = cv2.Animation()
        animation.frames = self._frames
        animation.durations = [10 * round(100.0 / fps)] * len(self._frames)
        if not cv2.imwriteanimation(str(path), animation, GIF_COLORS):
            raise OSError("OpenCV cannot write a GIF there; is the disk full?")
