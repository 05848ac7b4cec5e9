"""A video of the attempt: what each camera sees, at a low rate of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import Camera
from grasp_factory.core.geometry import Array
from grasp_factory.simulation.sensors.images import Render

Frames = Mapping[str, tuple[Camera, Render]]
"""By camera."""


class VideoRecorder:
    """Frames of every camera."""

    def __init__(self, look: Callable[[], Frames]) -> None:
        self._look = look
        self._timestamps: list[float] = []
        self._frames: list[dict[str, tuple[Array, NDArray[np.uint8]]]] = []

    def sample(self, timestamp: float) -> None:
        """Take a frame with every camera."""
        self._timestamps.append(timestamp)
        # Of a render, only the image is kept, and not as a view of all four channels.
        frames = self._look()
        self._frames.append(
            {
                name: (camera.T_world_camera, whole.rgb.copy())
                for name, (camera, whole) in frames.items()
            }
        )

    def series(self, cameras: Mapping[str, tuple[int, int]]) -> dict[str, NDArray[Any]]:
        """Return ``timestamp`` (n,), and ``rgb`` and ``T_world_camera`` of each camera.

        Args:
            cameras: Width and height of each camera's images, pixels.
        """
        out: dict[str, NDArray[Any]] = {"timestamp": np.array(self._timestamps, np.float64)}
        for name, (width, height) in cameras.items():
            poses = [frames[name][0] for frames in self._frames]
            rgb = [frames[name][1] for frames in self._frames]
            out[f"{name}/rgb"] = np.array(rgb, np.uint8).reshape(-1, height, width, 3)
            out[f"{name}/T_world_camera"] = np.array(poses, np.float64).reshape(-1, 4, 4)
        return out
