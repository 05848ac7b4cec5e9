"""Camera images: RGB, metric depth and stable scene labels.

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
from grasp_factory.geometry import Array, look_at
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

    @property
    def nbytes(self) -> int:
        """Memory that it takes, with the channel that its RGB is a view of."""
        return self.zbuffer.nbytes + self.mask.nbytes + self.rgb.nbytes // 3 * 4

    def pixels_of(self, body: int) -> int:
        """Return how many pixels show a body."""
        return int(np.count_nonzero((self.mask >= 0) & (self.mask & _BODY_MASK == body)))

    def behind(self, front: Render) -> Render:
        """Return the composite of this render with another one of the same camera."""
        nearer = front.zbuffer < self.zbuffer
        return Render(
            np.where(nearer[..., None], front.rgb, self.rgb),
            np.where(nearer, front.zbuffer, self.zbuffer),
            np.where(nearer, front.mask, self.mask),
        )


def make_camera(
    name: str,
    config: CameraConfig,
    resolution: tuple[int, int],
    T_world_mount: Array | None = None,
) -> Camera:
    """Return the camera that a config describes.

    Args:
        name: Of the camera.
        config: Where it looks, in the frame of its mount.
        resolution: Width and height, pixels.
        T_world_mount: Pose (4, 4) of what it is fixed to; None for the world itself.
    """
    width, height = resolution
    intrinsics = Intrinsics.from_fov(width, height, np.radians(config.fov_y_deg))
    T_world_camera = look_at(config.eye, config.target, config.up)
    if T_world_mount is not None:
        T_world_camera = T_world_mount @ T_world_camera
    return Camera(name, intrinsics, T_world_camera, config.near, config.far)


def render(world: World, camera: Camera, light: Light) -> Render:
    """Render all bodies that are not hidden; the world is not stepped."""
    return Render(*world.render(camera, light))


def develop(whole: Render, camera: Camera, labels: NDArray[np.uint8]) -> CameraImage:
    """Turn a render into an image: metric depth and stable labels.

    Args:
        whole: Everything there is to see.
        camera: What it was seen by.
        labels: ``Label`` by [body, link + 1], as ``Scene.labels`` has it.
    """
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
