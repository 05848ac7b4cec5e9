"""LeRobot v3.0: frames, states and actions for policy learning, with all series as windows.

A frame has the images of every camera, the state, the action and the records since the frame
before. ``extras/`` has what does not belong to a frame. ``meta/arrays.json`` says which feature
holds which array of the store. Layout:
https://github.com/huggingface/lerobot/blob/v0.4.4/src/lerobot/datasets/utils.py
"""

# ruff: noqa: PLC0415

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from grasp_factory.writers.exporters.base import (
    REAL_ROWS,
    REAL_SERIES,
    ExportContents,
    Exporter,
    ExportFolder,
    ExportJob,
    ExportPart,
)
from grasp_factory.writers.exporters.lerobot.lerobot_settings import (
    LeRobotSettings,
    excludes,
    split,
)

if TYPE_CHECKING:
    from grasp_factory.writers.exporters.lerobot.part_files import LeRobotPart


def write_part(job: ExportJob, part: ExportPart) -> LeRobotPart:
    """Write the files of a part."""
    from grasp_factory.writers.exporters.lerobot.part_files import write_part_files

    return write_part_files(job, part)


def finish(job: ExportJob, parts: Sequence[LeRobotPart]) -> None:
    """Write the files about all episodes."""
    from grasp_factory.writers.exporters.lerobot.dataset_files import write_dataset_files

    write_dataset_files(job, parts)


def read_back(folder: ExportFolder, place: int) -> dict[str, NDArray[Any]]:
    """Return the series of an episode by path; see ``Exporter.read_back``."""
    from grasp_factory.writers.exporters.lerobot.reading import read_back

    return read_back(folder, place)


LEROBOT = Exporter(
    name="lerobot",
    description="LeRobot v3.0 dataset: Parquet files and MP4 videos for policy learning",
    contents=ExportContents(
        written=(
            "streams/*",
            "imu/*",
            "videos/*",
            "cameras/*/intrinsics",
            "cameras/*/T_world_camera",
            "cameras/*/visibility",
            *REAL_SERIES,
        ),
        left_out={
            "cameras/*/rgb": "a frame belongs to the attempt; these are from before and after it",
            "cameras/*/depth": "the videos have no depth, and the images are no frames",
            "cameras/*/segmentation": "the images are no frames of the attempt",
        },
        treatment={
            "videos": "lossy; exact with video=image, which stores PNG. A side of an odd length is"
            " a pixel longer in a video",
            "time": "timestamp is frame_index / fps; the times of the store are in"
            " streams.timestamp, imu.timestamp and videos.timestamp",
            "series": "a frame has the records after the frame before, up to its own; records"
            " after the last frame are in extras/, so every series is complete. No record is"
            " before the first frame's",
            "action": "the commands of the next frame; the last frame has the last commands",
            "truth": "what a robot does not measure is named truth.*, and contact points and"
            " commands streams.*: policies take only observation.*",
            "constants": "arrays that are no series, such as intrinsics, are in extras/",
            REAL_ROWS: "a frame is the latest image at the time (frame_index + 1) / fps, and"
            " videos.timestamp says when it was taken; imu, force_torque, joints and taxels of a"
            " store that may hold them are complete in extras/, at their own times; what was not"
            " measured, such as commands, is NaN",
            "numbers": "exact in the files; LeRobot's items have float32 in place of float64",
            "NaN": "kept; statistics leave it out",
            "statistics": "of observation*, action, next.* and the indices; a window's are over"
            " all its records, and 0 where there is no value",
            "no video": "an episode without video frames is left out",
            "splits": "info.json has one, train, as LeRobot writes it; the split, outcome and"
            " success of an episode are columns of meta/episodes",
        },
    ),
    excludes=excludes,
    split=split,
    write_part=write_part,
    finish=finish,
    read_back=read_back,
    parameters=LeRobotSettings,
    libraries=("pyarrow",),
    extra="lerobot",
)

__all__ = ["LEROBOT"]
