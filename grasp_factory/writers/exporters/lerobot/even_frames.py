"""Frames of real episodes at LeRobot's even rate; a camera takes its images when it can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import Episode
from grasp_factory.core.sensors import STREAMS, VIDEOS, series_groups
from grasp_factory.core.series_group import SeriesGroup
from grasp_factory.writers.exporters.selection import Selection


def windowed_groups(config: FactoryConfig) -> tuple[SeriesGroup, ...]:
    """Return the groups of time series whose records are divided among the frames.

    In a store that may hold real episodes, the others have samples at the devices' own times.
    """
    groups = (STREAMS, VIDEOS) if config.capture else series_groups()
    return tuple(group for group in groups if group.rate(config))


def frame_counts(episodes: Selection) -> NDArray[np.int64]:
    """Return the number of frames of each episode, (n,)."""
    config = episodes.config
    images = episodes.column(VIDEOS.count).astype(np.int64)
    steps = episodes.column(STREAMS.count).astype(np.int64)
    even = steps * config.video_hz // config.record_hz
    return np.where(episodes.is_real & (images > 0), even, images)


def with_even_frames(episode: Episode) -> Episode:
    """Return a real episode with frames at an even rate; a simulated one has them already.

    Frame k is the latest image at the time (k + 1) / video_hz, or else the first one. It keeps the
    time when it was taken.
    """
    if not episode.is_real:
        return episode
    spec, videos = episode.spec, episode.videos
    count = episode.n_steps * spec.video_hz // spec.record_hz
    at = np.arange(1, count + 1) / spec.video_hz
    latest = np.searchsorted(videos["timestamp"], at, side="right") - 1
    chosen = {name: values[np.maximum(latest, 0)] for name, values in videos.items()}
    return replace(episode, own_rate={**episode.own_rate, VIDEOS.name: chosen})
