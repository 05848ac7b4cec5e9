"""MP4 files in MPEG-4 part 2, which every OpenCV can write, frame by frame."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def even_size(width: int, height: int) -> tuple[int, int]:
    """Return the size of a video of such images: a side of an odd length is a pixel longer."""
    return width + width % 2, height + height % 2


def with_even_sides(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image (H, W, 3) in C order; the last row or column of an odd side is repeated."""
    down, right = (side % 2 for side in image.shape[:2])
    if down or right:
        image = np.pad(image, ((0, down), (0, right), (0, 0)), "edge")
    return np.ascontiguousarray(image)


class Mp4File:
    """An MP4 file that is being written; see ``mp4_file``."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float) -> None:
        """Create the file.

        Args:
            path: the file, ending in .mp4.
            size: width and height of each image, pixels. The video's are even, because the format
                needs it: see ``with_even_sides``.
            fps: frames per second.

        Raises:
            OSError: if it cannot be created.
        """
        self._path = path
        codec = cv2.VideoWriter_fourcc(*"mp4v")  # type: ignore[attr-defined]
        self._writer = cv2.VideoWriter(str(path), codec, fps, even_size(*size))
        self._written = 0
        if not self._writer.isOpened():
            raise OSError("OpenCV cannot make an MP4 video there")

    def add(self, image: NDArray[np.uint8]) -> None:
        """Append a frame, BGR (height, width, 3)."""
        self._writer.write(with_even_sides(image))
        self._written += 1

    def finish(self) -> None:
        """Write the rest, and check that no frame is missing: OpenCV does not report a full disk.

        Raises:
            OSError: if frames are missing.
        """
        self._writer.release()
        reader = cv2.VideoCapture(str(self._path))
        found = int(reader.get(cv2.CAP_PROP_FRAME_COUNT)) if reader.isOpened() else 0
        reader.release()
        if found != self._written:
            raise OSError(f"{found} of {self._written} frames arrived; is the disk full?")

    def close(self) -> None:
        """Close the file."""
        self._writer.release()


@contextlib.contextmanager
def mp4_file(path: Path, size: tuple[int, int], fps: float) -> Iterator[Mp4File]:
    """Yield an MP4 file for frames; it is complete when the block ends without an error.

    Raises:
        OSError: if it cannot be written, or frames are missing at the end.
    """
    with contextlib.closing(Mp4File(path, size, fps)) as file:
        yield file
        file.finish()
