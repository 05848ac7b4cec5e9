"""A video of the attempt: images of every camera at ``video_hz``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.simulation.scene import Scene, render_cameras
from grasp_factory.simulation.sensors.base import Sensor, Tick


class VideoRecorder(Sensor):
    """RGB frames of every camera, and the cameras' poses."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._timestamps: list[float] = []
        self._frames: list[dict[str, tuple[Array, NDArray[np.uint8]]]] = []

    def sample(self, tick: Tick) -> None:
        """Take a frame with every camera."""
        self._timestamps.append(tick.timestamp)
        # Copied, because the renderer's RGB is a view of an array with four channels.
        frames = render_cameras(self._scene)
        self._frames.append(
            {
                name: (camera.T_world_camera, whole.rgb.copy())
                for name, (camera, whole) in frames.items()
            }
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return ``timestamp`` (n,), and ``rgb`` and ``T_world_camera`` of each camera."""
        out: dict[str, NDArray[Any]] = {"timestamp": np.array(self._timestamps, np.float64)}
        width, height = self._scene.spec.resolution
        for name in self._scene.spec.cameras:
            poses = [frames[name][0] for frames in self._frames]
            rgb = [frames[name][1] for frames in self._frames]
            out[f"{name}/rgb"] = np.array(rgb, np.uint8).reshape(-1, height, width, 3)
            out[f"{name}/T_world_camera"] = np.array(poses, np.float64).reshape(-1, 4, 4)
        return out
