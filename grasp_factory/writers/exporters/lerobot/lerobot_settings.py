"""Settings of the LeRobot format, and which episodes it can hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.optional import require
from grasp_factory.core.sensors import VIDEOS
from grasp_factory.core.serialization import check, check_range
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters.base import episodes_of_each_file, parts_of
from grasp_factory.writers.exporters.lerobot.even_frames import frame_counts, windowed_groups
from grasp_factory.writers.exporters.selection import Selection
from grasp_factory.writers.exporters.steps import NO_FRAMES, without_frames

MP4V, AV1, IMAGE = "mp4v", "av1", "image"
STORAGES = (MP4V, AV1, IMAGE)
"""How images are stored: MPEG-4 part 2 by OpenCV, AV1 by PyAV, or PNG in the Parquet files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeRobotSettings:
    """Settings of the format."""

    video: str = MP4V
    """One of ``STORAGES``: mp4v, av1 (smaller; needs the extra ``av``) or image (exact)."""
    episodes_per_file: int = 0
    """Episodes in a Parquet file and in a video file; 0 for an eighth of all, 8 to 64."""

    def __post_init__(self) -> None:
        check(self.video in STORAGES, "video", self.video, ", ".join(STORAGES))
        check_range(self, "episodes_per_file", 0, 1_000_000)


def split(episodes: Selection, settings: LeRobotSettings) -> list[range]:
    """Return the episodes of each file."""
    n = len(episodes)
    return parts_of(n, episodes_of_each_file(n, settings.episodes_per_file))


def excludes(episodes: Selection, settings: LeRobotSettings) -> Mapping[str, NDArray[np.bool_]]:
    """Return the episodes without frames, and those whose series end before the last frame.

    Raises:
        UsageError: if the stores have no videos, the rate of a series is not a multiple of the
            videos' rate, or PyAV is needed and missing.
    """
    if settings.video == AV1:
        require("av", extra="av")
    no_images, frames = without_frames(episodes), frame_counts(episodes)
    found = {NO_FRAMES: no_images | (frames == 0)}
    fps = episodes.config.video_hz
    for group in windowed_groups(episodes.config):
        if group is VIDEOS:
            continue
        rate = group.rate(episodes.config)
        per_frame, rest = divmod(rate, fps)
        if rest:
            raise UsageError(
                f"{episodes.sources[0].path}: the rate of {group.name} is {rate} Hz, valid: a"
                f" multiple of the videos' rate, which is {fps} Hz; generate a dataset"
                " with --video-hz 10"
            )
        found[f"{group.title} end before the last frame"] = (
            episodes.column(group.count) < frames * per_frame
        )
    return found
