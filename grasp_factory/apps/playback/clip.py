"""A clip of a stored attempt for a page: its motion, rendered small, as a few JPEG images."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grasp_factory.apps.pictures.painting import BgrImage
from grasp_factory.apps.playback.playback import Playback, stored_or_named_camera
from grasp_factory.core.executors import SendMessage
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.factory import embedded_assets
from grasp_factory.factory.plugins import activate
from grasp_factory.simulation.world.playback_world import PosedWorld

RATE_HZ = 10.0
"""Images per second of a short attempt; a long one has as many as ``ClipJob.most`` allows."""
_JPEG = (cv2.IMWRITE_JPEG_QUALITY, 80)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """What a clip shows."""

    path: Path
    """Of the store."""
    row: int
    """An episode that is committed."""
    camera: str
    """One of the episode's."""
    side: int
    """Pixels of the longer side; the other follows from the episode's images."""
    most: int
    """Maximum number of images."""


def make_clip(job: ClipJob, report: SendMessage) -> bytes:
    """Return a clip as ``packed`` does; the time of each image is reported before it is rendered.

    Raises:
        StoreError: if the episode is damaged.
        ConfigError: if its motion is not that of an attempt.
        PluginError: if it needs code of the user that was not given.
        RecipeError: if an object of the episode cannot be loaded.
    """
    dataset = Dataset(job.path)
    activate(dataset.config)
    embedded_assets.unpack(job.path, dataset.config)
    episode = dataset[job.row]
    scale = job.side / max(episode.spec.resolution)
    width, height = (max(1, round(scale * pixels)) for pixels in episode.spec.resolution)
    with PosedWorld(dataset.config.renderer) as world:
        camera = stored_or_named_camera(episode.spec, job.camera)
        playback = Playback(world, episode, camera, (width, height))
        times = clip_times(playback.track.duration, job.most)
        images = []
        for time, image in playback.frames(times):
            report(time)
            images.append((time, image))
    return packed(images)


def clip_times(duration: float, most: int) -> list[float]:
    """Return the times (s) of a clip's images: evenly from 0 to the attempt's end."""
    count = min(most, max(2, math.ceil(duration * RATE_HZ) + 1))
    return [float(time) for time in np.linspace(0.0, duration, count)]


def packed(images: Iterable[tuple[float, BgrImage]]) -> bytes:
    """Return times and images (BGR) as bytes, little-endian.

    First the number of images (uint32), then of each its time (float32, s) and its size in bytes
    (uint32), then the images one after the other as JPEG files.
    """
    head, files = [], []
    for time, image in images:
        ok, data = cv2.imencode(".jpg", image, _JPEG)
        assert ok
        head.append(struct.pack("<fI", time, len(data)))
        files.append(data.tobytes())
    return struct.pack("<I", len(files)) + b"".join(head) + b"".join(files)
