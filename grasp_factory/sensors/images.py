"""Camera capture: RGB, metric depth and stable scene labels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp_factory.camera import Camera, Intrinsics, Light, zbuffer_to_depth
from grasp_factory.config import CameraConfig
from grasp_factory.episode import CameraImage
from grasp_factory.geometry import look_at
from grasp_factory.outcome import Label
from grasp_factory.world import World

_BODY_MASK = (1 << 24) - 1


def make_camera(name: str, config: CameraConfig, resolution: tuple[int, int]) -> Camera:
    """Return the camera that a config describes."""
    width, height = resolution
    intrinsics = Intrinsics.from_fov(width, height, np.radians(config.fov_y_deg))
    T_world_camera = look_at(config.eye, config.target, config.up)
    return Camera(name, intrinsics, T_world_camera, config.near, config.far)


def capture(world: World, camera: Camera, labels: NDArray[np.uint8]) -> CameraImage:
    """Render one image.

    Args:
        world: The world, which is not stepped.
        camera: Where to look from.
        labels: ``Label`` by [body, link + 1], as ``Scene.labels`` has it.
    """
    rgb, zbuffer, mask = world.render(camera, Light())
    depth = zbuffer_to_depth(zbuffer.astype(np.float64), camera.near, camera.far)
    seen = mask >= 0
    segmentation = np.full(mask.shape, int(Label.BACKGROUND), np.uint8)
    segmentation[seen] = labels[mask[seen] & _BODY_MASK, mask[seen] >> 24]
    return CameraImage(
        rgb=np.ascontiguousarray(rgb),
        depth=depth.astype(np.float32),
        segmentation=segmentation,
        intrinsics=camera.intrinsics.matrix(),
        T_world_camera=camera.T_world_camera,
    )
