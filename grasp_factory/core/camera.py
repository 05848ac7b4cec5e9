"""The pinhole camera: intrinsics, OpenGL matrices for the renderer, metric depth, deprojection.

Camera frames follow OpenCV (+x right, +y down, +z forward). Only ``opengl_view`` and
``opengl_projection`` convert them to OpenGL's convention.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.elementary import sincos
from grasp_factory.core.geometry import Array, inverse
from grasp_factory.core.linear import turned
from grasp_factory.core.renderer import Renderer


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera without distortion; pixels are sampled at integer pixel coordinates."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def from_fov(
        cls, width: int, height: int, fov_y: float, renderer: Renderer = Renderer.TINY
    ) -> Intrinsics:
        """Return square-pixel intrinsics for a vertical field of view in radians."""
        sine, cosine = sincos(fov_y / 2.0)
        f = height / 2.0 * cosine / sine
        dx, dy = renderer.pixel_offset
        return cls(width, height, float(f), float(f), width / 2.0 - dx, height / 2.0 - dy)

    def matrix(self) -> Array:
        """Return K, shape (3, 3), pixels."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Camera:
    """Intrinsics, pose and clipping range of one camera."""

    name: str
    intrinsics: Intrinsics
    T_world_camera: Array
    """Shape (4, 4), OpenCV axes."""
    near: float
    """Metres."""
    far: float
    """Metres."""
    renderer: Renderer = Renderer.TINY
    """The renderer of its images: the sampling point inside a pixel depends on it."""

    def cropped(self, left: int, top: int, width: int, height: int) -> Camera:
        """Return the camera whose image is this part (in pixels) of this camera's image."""
        k = self.intrinsics
        part = Intrinsics(width, height, k.fx, k.fy, k.cx - left, k.cy - top)
        return dataclasses.replace(self, intrinsics=part)

    def opengl_view(self) -> Array:
        """Return the OpenGL view matrix (4, 4): world to camera with +y up, -z forward."""
        return np.array([[1.0], [-1.0], [-1.0], [1.0]]) * inverse(self.T_world_camera)

    def opengl_projection(self) -> Array:
        """Return the OpenGL projection matrix (4, 4)."""
        k, n, f = self.intrinsics, self.near, self.far
        P = np.zeros((4, 4))
        dx, dy = self.renderer.pixel_offset
        P[0, 0], P[0, 2] = 2.0 * k.fx / k.width, 1.0 - 2.0 * (k.cx + dx) / k.width
        P[1, 1], P[1, 2] = 2.0 * k.fy / k.height, 2.0 * (k.cy + dy) / k.height - 1.0
        P[2, 2], P[2, 3] = -(f + n) / (f - n), -2.0 * f * n / (f - n)
        P[3, 2] = -1.0
        return P


@dataclass(frozen=True, slots=True)
class Light:
    """A directional light. Each render sets all values, because the renderer keeps old ones."""

    direction: tuple[float, float, float] = (0.6, 0.9, 1.5)
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ambient: float = 0.6
    diffuse: float = 0.5
    specular: float = 0.05


def zbuffer_to_depth(zbuffer: Array, near: float, far: float) -> Array:
    """Return metres along the optical axis for z-buffer values in [0, 1], any shape."""
    return np.asarray(far * near / (far - (far - near) * zbuffer))


def deproject(depth: Array, K: Array) -> Array:
    """Return the points (H, W, 3) in the camera frame, metres, of a depth image (H, W)."""
    height, width = depth.shape
    return deproject_pixels(np.arange(width), np.arange(height)[:, None], depth, K)


def deproject_pixels(u: NDArray[Any], v: NDArray[Any], depth: Array, K: Array) -> Array:
    """Return the points (..., 3) in the camera frame, metres, of pixels (u, v) and their depth."""
    x = (u - K[0, 2]) / K[0, 0] * depth
    y = (v - K[1, 2]) / K[1, 1] * depth
    return np.stack([x, y, depth], axis=-1)


def project(points: Array, K: Array) -> Array:
    """Return the pixels (..., 2) as (u, v) of points (..., 3) in the camera frame."""
    uvw = turned(K, points)
    return np.asarray(uvw[..., :2] / uvw[..., 2:])
