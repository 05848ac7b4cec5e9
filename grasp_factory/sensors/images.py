"""Camera capture: RGB, metric depth and stable scene labels.

What never moves is rendered once and composited: with shadows off, a pixel belongs to whatever
has the smaller z-buffer value, so the result is the full render's, bit for bit (a test holds it
to that), at a fifth of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.camera import Camera, Intrinsics, Light, zbuffer_to_depth
from grasp_factory.episode import CameraImage
from grasp_factory.geometry import look_at
from grasp_factory.outcome import Label
from grasp_factory.sections import CameraConfig
from grasp_factory.world import World

_BODY_MASK = (1 << 24) - 1


@dataclass(frozen=True, slots=True)
class Render:
    """One camera's raw render."""

    rgb: NDArray[np.uint8]
    """(H, W, 3)."""
    zbuffer: NDArray[np.float32]
    """(H, W), 1 where nothing is seen."""
    mask: NDArray[np.int32]
    """(H, W): body + (link + 1) * 2^24, or -1."""

    def behind(self, front: Render) -> Render:
        """Return the composite of this render with another one of the same camera."""
        nearer = front.zbuffer < self.zbuffer
        return Render(
            np.where(nearer[..., None], front.rgb, self.rgb),
            np.where(nearer, front.zbuffer, self.zbuffer),
            np.where(nearer, front.mask, self.mask),
        )


def make_camera(name: str, config: CameraConfig, resolution: tuple[int, int]) -> Camera:
    """Return the camera that a config describes."""
    width, height = resolution
    intrinsics = Intrinsics.from_fov(width, height, np.radians(config.fov_y_deg))
    T_world_camera = look_at(config.eye, config.target, config.up)
    return Camera(name, intrinsics, T_world_camera, config.near, config.far)


def render(world: World, camera: Camera) -> Render:
    """Render all bodies that are not hidden; the world is not stepped."""
    return Render(*world.render(camera, Light()))


def capture(
    world: World, camera: Camera, background: Render, labels: NDArray[np.uint8]
) -> CameraImage:
    """Take one image.

    Args:
        world: The world, which is not stepped; what is in the background is hidden in it.
        camera: Where to look from.
        background: What never moves, seen by the same camera.
        labels: ``Label`` by [body, link + 1], as ``Scene.labels`` has it.
    """
    whole = background.behind(render(world, camera))
    metres = zbuffer_to_depth(whole.zbuffer.astype(np.float64), camera.near, camera.far)
    seen = whole.mask >= 0
    segmentation = np.full(whole.mask.shape, int(Label.BACKGROUND), np.uint8)
    segmentation[seen] = labels[whole.mask[seen] & _BODY_MASK, whole.mask[seen] >> 24]
    depth = metres.astype(np.float32)
    for image in (whole.rgb, depth, segmentation):
        image.flags.writeable = False  # a policy sees the very arrays that are stored
    return CameraImage(
        rgb=whole.rgb,
        depth=depth,
        segmentation=segmentation,
        intrinsics=camera.intrinsics.matrix(),
        T_world_camera=camera.T_world_camera,
    )
