"""The target's surface in depth images: points with normals, its outline, and assumed walls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import deproject
from grasp_factory.core.episode import CameraImage, SceneView
from grasp_factory.core.geometry import Array, apply
from grasp_factory.core.linear import norm, turned, turned_back

BASELINE = 2
"""Distance of the pixels to each side that are used for the surface's derivatives."""
BEND = 0.005
"""Largest difference between a pixel's depth and the mean of its neighbours on a smooth surface.

Metres. For a plane the difference is about zero, even at a grazing angle.
"""
JUMP = 0.010
"""Smallest depth step between adjacent pixels that separates target and background, metres."""
SOFTENING = 3
"""Pixels to each side over which the mask is averaged before the outline's normal is computed."""
WALL_STEP = 0.005
"""Vertical distance between the points of a wall, metres."""
LEAST_SLOPE = 0.2
"""Smallest length of the horizontal part of the unit normal; otherwise there is no wall below."""


@dataclass(frozen=True, slots=True)
class Surface:
    """Points of a surface in the world frame."""

    points: Array
    """(K, 3) metres."""
    normals: Array
    """(K, 3) unit, pointing out of the body."""

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, most: int) -> Surface:
        """Return at most ``most`` of the points, evenly spaced in their order."""
        if len(self) <= most:
            return self
        rows = np.linspace(0, len(self) - 1, most).astype(int)
        return Surface(self.points[rows], self.normals[rows])

    def where(self, rows: NDArray[np.bool_]) -> Surface:
        """Return the points that a mask (K,) selects."""
        return Surface(self.points[rows], self.normals[rows])


def joined(surfaces: list[Surface]) -> Surface:
    """Return the points of several surfaces as one."""
    empty = np.zeros((0, 3))
    points = np.vstack([empty, *(surface.points for surface in surfaces)])
    return Surface(points, np.vstack([empty, *(surface.normals for surface in surfaces)]))


def seen_surface(view: SceneView) -> Surface:
    """Return the target's visible surface over all cameras, where it is smooth enough."""
    return joined([_seen(crop) for crop in _crops(view)])


def walls_below(edge: Surface) -> Surface:
    """Return vertical walls from an outline down to the table, the highest points first."""
    highest = float(edge.points[:, 2].max(initial=0.0))
    rows = []
    for drop in np.arange(0.0, highest, WALL_STEP):
        lowered = Surface(edge.points - (0.0, 0.0, drop), edge.normals)
        rows.append(lowered.where(lowered.points[:, 2] > 0.0))
    return joined(rows)


def outline(view: SceneView) -> Surface:
    """Return the outline: where the visible surface ends and the background is farther away.

    The surface behind it is not visible. The normals are those of a vertical wall below the
    outline. The plane through the view ray and the outline is tangent to the body; the normal is
    the horizontal part of this plane's normal.
    """
    return joined([_outline(crop) for crop in _crops(view)])


@dataclass(frozen=True, slots=True)
class _Crop:
    """The part of an image around the target."""

    points: Array
    """(h, w, 3) metres, camera frame."""
    mask: NDArray[np.bool_]
    """(h, w), true at the target's pixels."""
    intrinsics: Array
    """(3, 3) of the crop."""
    T_world_camera: Array


def _crops(view: SceneView) -> list[_Crop]:
    return [
        _crop(image, image.segmentation == view.target_label)
        for image in view.images.values()
        if (image.segmentation == view.target_label).any()
    ]


def _crop(image: CameraImage, mask: NDArray[np.bool_]) -> _Crop:
    """Return the crop around the target, with the border that the derivatives need."""
    border = SOFTENING + 2
    v, u = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, left = max(0, v[0] - border), max(0, u[0] - border)
    window = np.s_[top : v[-1] + border + 1, left : u[-1] + border + 1]
    K = image.intrinsics.copy()
    K[:2, 2] -= (left, top)
    depth = image.depth[window].astype(np.float64)
    return _Crop(deproject(depth, K), mask[window], K, image.T_world_camera)


def _seen(crop: _Crop) -> Surface:
    """Return points with normals from central differences, where all pixels are on one surface."""
    s = BASELINE
    P, inner = crop.points, np.s_[s:-s, s:-s]
    if min(P.shape[:2]) <= 2 * s:
        return joined([])
    left, right, up, down = (
        np.s_[s:-s, : -2 * s], np.s_[s:-s, 2 * s :], np.s_[: -2 * s, s:-s], np.s_[2 * s :, s:-s]
    )  # fmt: skip
    smooth = crop.mask[inner].copy()
    depth = P[..., 2]
    for one, other in ((left, right), (up, down)):
        bend = (depth[one] + depth[other]) / 2.0 - depth[inner]
        smooth &= crop.mask[one] & crop.mask[other] & (np.abs(bend) < BEND)
    points = P[inner][smooth]
    normals = np.cross((P[down] - P[up])[smooth], (P[right] - P[left])[smooth])
    lengths = norm(normals)
    normals /= np.maximum(lengths, 1e-12)[:, None]
    normals *= -np.sign((normals * points).sum(axis=1))[:, None]  # towards the camera
    good = lengths > 0.0
    T = crop.T_world_camera
    return Surface(apply(T, points[good]), turned(T[:3, :3], normals[good]))


def _outline(crop: _Crop) -> Surface:
    """Return the last pixels before a farther background, with horizontal normals."""
    mask, depth = crop.mask, crop.points[..., 2]
    ends = np.zeros_like(mask)
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        beyond = np.roll(depth, step, axis) - depth > JUMP
        ends |= mask & ~np.roll(mask, step, axis) & beyond
    ends[[0, -1], :] = ends[:, [0, -1]] = False  # here the image ends or np.roll wraps around
    v, u = np.nonzero(ends)
    soft = _softened(mask)
    b, a = (-np.asarray(np.gradient(soft, axis=axis))[v, u] for axis in (0, 1))  # outwards
    T = crop.T_world_camera
    lines = np.stack([a, b, -(a * u + b * v)], axis=1)
    normals = turned(T[:3, :3], turned_back(crop.intrinsics, lines))
    normals /= np.maximum(norm(normals), 1e-12)[:, None]
    normals[:, 2] = 0.0
    lengths = norm(normals)
    good = lengths > LEAST_SLOPE
    return Surface(apply(T, crop.points[v, u][good]), normals[good] / lengths[good, None])


def _softened(mask: NDArray[np.bool_]) -> Array:
    """Return the mask's mean over a square around each pixel."""
    size = 2 * SOFTENING + 1
    sums = np.pad(mask.astype(np.float64), SOFTENING)
    for axis in (0, 1):
        windows = np.lib.stride_tricks.sliding_window_view(sums, size, axis=axis)
        sums = windows.mean(axis=-1)
    return np.asarray(sums)
