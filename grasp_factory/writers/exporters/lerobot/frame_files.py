"""Where the images of the frames go: to a video for each camera, or as PNG to the table."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.mp4_file import even_size, mp4_file, with_even_sides
from grasp_factory.writers.exporters.base import ExportJob
from grasp_factory.writers.exporters.images import png
from grasp_factory.writers.exporters.lerobot.features import IMAGES
from grasp_factory.writers.exporters.lerobot.lerobot_settings import AV1, IMAGE
from grasp_factory.writers.exporters.lerobot.numbering import VIDEO, new_file

Images = Mapping[str, NDArray[np.uint8]]
"""Frames by camera, RGB (K, H, W, 3)."""

PIXELS = "yuv420p"
"""The pixel format of both codecs."""
AV1_OPTIONS = {"g": "2", "crf": "30", "preset": "8", "svtav1-params": "lp=1"}
"""Key frames and quality as LeRobot encodes: ``encode_video_frames`` in
https://github.com/huggingface/lerobot/blob/v0.4.4/src/lerobot/datasets/video_utils.py
One thread (lp=1), because otherwise the bytes depend on the processor."""
QUIET = ("SVT_LOG", "1")
"""The environment variable by which SVT-AV1 prints errors only:
``svt_log.c`` of https://gitlab.com/AOMediaCodec/SVT-AV1"""
CODEC_NAMES = {"mp4v": "mpeg4", "av1": "av1"}
"""FFmpeg's names, which LeRobot's info.json has."""


class FrameFile(Protocol):
    """A video file that is being written."""

    def add(self, image: NDArray[np.uint8]) -> None:
        """Append a frame, BGR (height, width, 3)."""


def frame_file(
    path: Path, size: tuple[int, int], fps: int, codec: str
) -> contextlib.AbstractContextManager[FrameFile]:
    """Return a video file for frames of a size (width, height), pixels.

    A side of an odd length becomes a pixel longer. The same frames yield the same bytes.

    Raises:
        OSError: if it cannot be written.
    """
    return _av1_file(path, size, fps) if codec == AV1 else mp4_file(path, size, fps)


@dataclass(frozen=True, slots=True)
class _Av1File:
    container: Any
    stream: Any

    def add(self, image: NDArray[np.uint8]) -> None:
        """Append a frame, BGR (height, width, 3)."""
        from av import VideoFrame  # noqa: PLC0415

        frame = VideoFrame.from_ndarray(with_even_sides(image), format="bgr24")
        self.container.mux(self.stream.encode(frame))


@contextlib.contextmanager
def _av1_file(path: Path, size: tuple[int, int], fps: int) -> Iterator[_Av1File]:
    import av  # noqa: PLC0415

    os.environ.setdefault(*QUIET)
    try:
        with av.open(str(path), "w") as container:
            stream = container.add_stream("libsvtav1", rate=fps, options=AV1_OPTIONS)
            stream.width, stream.height = even_size(*size)
            stream.pix_fmt = PIXELS
            stream.codec_context.thread_count = 1
            yield _Av1File(container, stream)
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise OSError(f"PyAV cannot write {path.name}: {error}") from None


@contextlib.contextmanager
def image_store(job: ExportJob, part: int) -> Iterator[Callable[[Images], dict[str, list[bytes]]]]:
    """Yield a function that stores an episode's images, and returns those for its table as PNG.

    Raises:
        OSError: if a video cannot be written.
    """
    if job.settings.video == IMAGE:
        yield lambda images: {
            f"{IMAGES}{camera}": [png(image) for image in frames]
            for camera, frames in images.items()
        }
        return
    config = job.episodes.config
    with contextlib.ExitStack() as open_files:
        files = {
            camera: open_files.enter_context(
                frame_file(
                    new_file(job.folder, f"{VIDEO}/{IMAGES}{camera}", ".mp4", part),
                    config.resolution,
                    config.video_hz,
                    job.settings.video,
                )
            )
            for camera in config.cameras
        }

        def add(images: Images) -> dict[str, list[bytes]]:
            for camera, frames in images.items():
                for image in frames:
                    files[camera].add(image[..., ::-1])
            return {}

        yield add
