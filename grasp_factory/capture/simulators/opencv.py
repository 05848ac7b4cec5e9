"""A simulated camera: the images of an episode as a video file without loss (FFV1)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from grasp_factory.capture.samples import CameraFrame
from grasp_factory.capture.simulators.recordings import SimulatedRecording
from grasp_factory.capture.simulators.tracks import DeviceTrack, camera_track, frozen, without_depth
from grasp_factory.core.episode import Episode
from grasp_factory.errors import CaptureError

RATE_HZ = 30.0


class SimulatedOpenCvCamera(SimulatedRecording[CameraFrame]):
    """Plays at 30 Hz, unless another rate is given.

    Args:
        episode: the episode.
        camera: name of its camera; empty for the first one.
        rate_hz: frames per second.
        playing: see ``SimulatedDevice``.
    """

    resolution = 0.0

    def __init__(
        self, episode: Episode, *, camera: str = "", rate_hz: float = 0.0, **playing: Any
    ) -> None:
        self._camera, self._rate_hz = camera or next(iter(episode.cameras)), rate_hz or RATE_HZ
        super().__init__(episode, rate_hz=self._rate_hz, **playing)
        self.track = frozen(self.track, self.faults.frozen_after_s)

    @property
    def settings(self) -> Mapping[str, Any]:
        """See ``SimulatedDevice.settings``."""
        return {"source": str(self.path), "speed": self.speed}

    def track_of(self, episode: Episode, rate_hz: float) -> DeviceTrack[CameraFrame]:
        """See ``SimulatedDevice.track_of``."""
        return without_depth(camera_track(episode, rate_hz, camera=self._camera))

    def write(self, path: Path) -> None:
        """See ``SimulatedRecording.write``."""
        height, width = self.track.payloads[0].rgb.shape[:2]
        codec = cv2.VideoWriter_fourcc(*"FFV1")  # type: ignore[attr-defined]
        named = path.with_suffix(".avi")
        writer = cv2.VideoWriter(str(named), codec, self._rate_hz, (width, height))
        if not writer.isOpened():
            raise CaptureError(f"{named} cannot be written: OpenCV has no FFV1")
        for _ in range(self.repeats):
            for frame in self.track.payloads:
                writer.write(np.ascontiguousarray(frame.rgb[..., ::-1]))
        writer.release()
        named.rename(path)
