"""Writes the files about all episodes of a LeRobot dataset: info, tasks, statistics, arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

from grasp_factory.core.serialization import to_plain
from grasp_factory.writers.exporters.base import ExportJob
from grasp_factory.writers.exporters.json_file import write_json
from grasp_factory.writers.exporters.lerobot.features import (
    IMAGES,
    LeRobotFeature,
    is_constant,
    own_series,
    windowed_series,
)
from grasp_factory.writers.exporters.lerobot.frame_files import CODEC_NAMES, PIXELS
from grasp_factory.writers.exporters.lerobot.lerobot_settings import IMAGE
from grasp_factory.writers.exporters.lerobot.numbering import (
    DATA,
    FILES_IN_CHUNK,
    VIDEO,
    FrameNumbering,
    numbering_of,
    path_pattern,
)
from grasp_factory.writers.exporters.lerobot.parquet_files import write_tasks
from grasp_factory.writers.exporters.lerobot.part_files import LeRobotPart
from grasp_factory.writers.exporters.lerobot.statistics import joined
from grasp_factory.writers.exporters.selection import Selection

VERSION = "v3.0"
"""``CODEBASE_VERSION`` in
https://github.com/huggingface/lerobot/blob/v0.4.4/src/lerobot/datasets/lerobot_dataset.py"""
DATA_MB, VIDEO_MB = 100, 200
"""Sizes at which LeRobot itself begins a new file; its defaults, which info.json must have."""


def write_dataset_files(job: ExportJob, parts: Sequence[LeRobotPart]) -> None:
    """Write ``meta/info.json``, ``tasks.parquet``, ``stats.json`` and ``arrays.json``."""
    numbering, features = numbering_of(job.episodes), parts[0].features
    moments = reduce(joined, (part.moments for part in parts))
    meta = job.folder / "meta"
    write_tasks(meta / "tasks.parquet", numbering.tasks)
    write_json(meta / "info.json", _info(job, numbering, features))
    write_json(
        meta / "stats.json",
        {name: one.plain(features[name].statistics_shape) for name, one in moments.items()},
    )
    write_json(meta / "arrays.json", dict(_arrays(job.episodes)))


def _info(
    job: ExportJob, numbering: FrameNumbering, features: Mapping[str, LeRobotFeature]
) -> dict[str, Any]:
    episodes, fps = job.episodes, job.episodes.config.video_hz
    has_videos = job.settings.video != IMAGE
    return {
        "codebase_version": VERSION,
        "robot_type": episodes.config.robot,
        "total_episodes": len(episodes),
        "total_frames": int(numbering.starts[-1]),
        "total_tasks": len(numbering.tasks),
        "chunks_size": FILES_IN_CHUNK,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": path_pattern(DATA, ".parquet"),
        "video_path": path_pattern(f"{VIDEO}/{{video_key}}", ".mp4") if has_videos else None,
        "features": {
            name: to_plain(feature) | _video_info(feature, fps, job.settings.video)
            for name, feature in features.items()
        },
    }


def _video_info(feature: LeRobotFeature, fps: int, codec: str) -> dict[str, Any]:
    if feature.dtype != "video":
        return {}
    height, width, channels = feature.shape
    return {
        "info": {
            "video.height": height,
            "video.width": width,
            "video.channels": channels,
            "video.codec": CODEC_NAMES[codec],
            "video.pix_fmt": PIXELS,
            "video.is_depth_map": False,
            "video.fps": fps,
            "has_audio": False,
        }
    }


def _arrays(episodes: Selection) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield where each array of the store is, and what it means."""
    places = {one.field.path: (one.name, one.per_frame) for one in windowed_series(episodes)}
    places |= {f"videos/{name}/rgb": (f"{IMAGES}{name}", 1) for name in episodes.config.cameras}
    own = {field.path for field in own_series(episodes)}
    for path, field in episodes.fields.items():
        meaning = {
            "dtype": field.dtype,
            "units": field.units,
            "frame": field.frame,
            "description": field.description,
            "words": list(field.names),
        }
        if path in places:
            feature, per_frame = places[path]
            yield path, {"feature": feature, "records_per_frame": per_frame, **meaning}
        elif is_constant(field) or path in own:
            yield path, {"extras": path, **meaning}
