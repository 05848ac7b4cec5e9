"""Writes the files of some episodes of a LeRobot dataset; no other part writes to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.writers.exporters.base import ExportJob, ExportPart
from grasp_factory.writers.exporters.lerobot.even_frames import with_even_frames
from grasp_factory.writers.exporters.lerobot.features import (
    IMAGES,
    LeRobotFeature,
    WindowedSeries,
    constants_of,
    features_of,
    frame_values,
    own_series,
    windowed_series,
)
from grasp_factory.writers.exporters.lerobot.frame_files import image_store
from grasp_factory.writers.exporters.lerobot.numbering import (
    DATA,
    EPISODES,
    EXTRAS,
    VIDEO,
    FrameNumbering,
    chunk_and_file,
    new_file,
    numbering_of,
)
from grasp_factory.writers.exporters.lerobot.parquet_files import (
    array_column,
    image_column,
    parquet_file,
    write_columns,
    write_rows,
)
from grasp_factory.writers.exporters.lerobot.statistics import (
    FrameMoments,
    joined,
    moments_of,
    moments_of_images,
)
from grasp_factory.writers.exporters.steps import EpisodeSteps, steps_of


@dataclass(frozen=True, slots=True, kw_only=True)
class LeRobotPart:
    """What the files about all episodes need to know of a part."""

    features: Mapping[str, LeRobotFeature]
    moments: Mapping[str, FrameMoments]
    """Statistics of the part's frames, by feature."""


def write_part_files(job: ExportJob, part: ExportPart) -> LeRobotPart:
    """Write the Parquet and video files of some episodes that follow each other."""
    numbering = numbering_of(job.episodes)
    series = {one.field.path: one for one in windowed_series(job.episodes)}
    rows: list[dict[str, Any]] = []
    extras: list[dict[str, NDArray[Any]]] = []
    total: dict[str, FrameMoments] = {}
    features: dict[str, LeRobotFeature] = {}
    data = new_file(job.folder, DATA, ".parquet", part.number)
    with parquet_file(data) as append, image_store(job, part.number) as store_images:
        for place, stored in part.episodes:
            episode = with_even_frames(stored)
            steps = steps_of(episode)
            values = frame_values(episode, steps, series) | numbering.columns(place)
            features = features_of(job.episodes, values, job.settings.video)
            moments = _moments(values, steps, series)
            images = store_images(steps.images)
            append(
                {name: image_column(pngs) for name, pngs in images.items()}
                | {name: array_column(array) for name, array in values.items()}
            )
            rows.append(
                _place_of_frames(numbering, part, place, job.episodes.config.video_hz, features)
                | _labels(episode)
                | _statistics(moments, features)
            )
            extras.append(_extras(job, episode, steps, series))
            total = joined(total, moments)
    write_rows(new_file(job.folder, EPISODES, ".parquet", part.number), rows)
    write_columns(
        new_file(job.folder, EXTRAS, ".parquet", part.number),
        {"episode_index": np.array(part.places)},
        {path: [row[path] for row in extras] for path in extras[0]},
    )
    return LeRobotPart(features=features, moments=total)


def _moments(
    values: Mapping[str, NDArray[Any]], steps: EpisodeSteps, series: Mapping[str, WindowedSeries]
) -> dict[str, FrameMoments]:
    """Return the statistics of an episode's frames; of series, only of those for policies."""
    windows = {one.name: one.per_frame for one in series.values()}
    images = {f"{IMAGES}{camera}": frames for camera, frames in steps.images.items()}
    return {name: moments_of_images(frames) for name, frames in images.items()} | {
        name: moments_of(array, windows.get(name, 1))
        for name, array in values.items()
        if name.startswith("observation") or name not in windows
    }


def _place_of_frames(
    numbering: FrameNumbering,
    part: ExportPart,
    place: int,
    fps: int,
    features: Mapping[str, LeRobotFeature],
) -> dict[str, Any]:
    """Return where an episode's frames are, as LeRobot has it in ``meta/episodes``."""
    chunk, file = chunk_and_file(part.number)
    first, start, end = (int(numbering.starts[k]) for k in (part.places[0], place, place + 1))
    row: dict[str, Any] = {
        "episode_index": place,
        "tasks": [numbering.tasks[numbering.task[place]]],
        "length": end - start,
        "dataset_from_index": start,
        "dataset_to_index": end,
    }
    for folder in (DATA, EPISODES):
        row |= {f"{folder}/chunk_index": chunk, f"{folder}/file_index": file}
    for name in (name for name, feature in features.items() if feature.dtype == "video"):
        row |= {
            f"{VIDEO}/{name}/chunk_index": chunk,
            f"{VIDEO}/{name}/file_index": file,
            f"{VIDEO}/{name}/from_timestamp": (start - first) / fps,
            f"{VIDEO}/{name}/to_timestamp": (end - first) / fps,
        }
    return row


def _labels(episode: Episode) -> dict[str, Any]:
    return {
        "success": episode.success,
        "outcome": episode.outcome.name.lower(),
        "split": str(episode.columns["split"]),
    }


def _statistics(
    moments: Mapping[str, FrameMoments], features: Mapping[str, LeRobotFeature]
) -> dict[str, Any]:
    return {
        f"stats/{name}/{key}": value
        for name, one in moments.items()
        for key, value in one.plain(features[name].statistics_shape).items()
    }


def _extras(
    job: ExportJob, episode: Episode, steps: EpisodeSteps, series: Mapping[str, WindowedSeries]
) -> dict[str, NDArray[Any]]:
    """Return what belongs to no frame of an episode, by path in the store."""
    contents, frames = episode.contents(), len(steps.timestamp)
    after = {path: one.after_frames(contents[path], frames) for path, one in series.items()}
    own = {field.path: contents[field.path] for field in own_series(job.episodes)}
    return after | own | constants_of(job.episodes, episode)
