"""Truncated signed distances to the surface that depth images show, in a cube of voxels.

Curless and Levoy, "A Volumetric Method for Building Complex Models from Range Images", 1996, in the
form of Open3D's UniformTSDFVolume: https://github.com/isl-org/Open3D,
cpp/open3d/pipelines/integration/UniformTSDFVolume.cpp
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, apply

TRUNCATED_VOXELS = 4
"""Distances are truncated at this number of voxels: VGN, src/vgn/perception.py, TSDFVolume."""
FARTHEST = 2.0
"""Metres; pixels of this depth or more have no surface: VGN's depth_trunc, in the same class."""
NEAR_SURFACE = 0.98
"""Largest absolute distance, in truncations, of voxels that Open3D returns; the others have 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthView:
    """A depth image and where it was taken from."""

    depth: NDArray[np.float32]
    """(H, W) metres along the optical axis; 0, NaN and infinity for none."""
    K: Array
    """Intrinsics, (3, 3) pixels; integer coordinates at the centres of pixels."""
    T_camera_cube: Array
    """(4, 4): maps the cube's coordinates to the camera's, OpenCV axes."""


def tsdf_grid(views: Iterable[DepthView], size: float, resolution: int) -> NDArray[np.float32]:
    """Return the distances in a cube, (R, R, R), indexed by x, y and z.

    A value is 0.5 at the surface, towards 1 in front of it and towards 0 behind it. It is the mean
    of all views in which the voxel is at most a truncation behind the surface. It is 0 where no
    view says anything, and where the mean is nearly a whole truncation or more from the surface.

    Args:
        views: of the scene.
        size: of the cube, metres. A corner is its origin, and its edges are the axes.
        resolution: R, voxels along an edge.
    """
    centres = (np.arange(resolution) + 0.5) * (size / resolution)
    points = np.stack(np.meshgrid(centres, centres, centres, indexing="ij"), axis=-1)
    total, views_of = np.zeros((2, resolution**3))
    for view in views:
        seen, distance = _distances(view, points.reshape(-1, 3))
        share = distance / (TRUNCATED_VOXELS * size / resolution)
        near = share > -1.0
        total[seen[near]] += np.minimum(share[near], 1.0)
        views_of[seen[near]] += 1.0
    mean = np.divide(total, views_of, out=np.ones_like(total), where=views_of > 0.0)
    is_near = (mean < NEAR_SURFACE) & (mean >= -NEAR_SURFACE)
    grid = np.where(is_near, (mean + 1.0) / 2.0, 0.0).astype(np.float32)
    return grid.reshape(resolution, resolution, resolution)


def _distances(view: DepthView, points: Array) -> tuple[NDArray[np.intp], Array]:
    """Return which points (P, 3) a view sees, (S,), and their distances in front of the surface.

    Distances are metres along the ray through the point's pixel.
    """
    height, width = view.depth.shape
    at_camera = apply(view.T_camera_cube, points)
    ahead = np.flatnonzero(at_camera[:, 2] > 0.0)
    x, y, z = at_camera[ahead].T
    column = np.floor(x / z * view.K[0, 0] + view.K[0, 2] + 0.5)
    row = np.floor(y / z * view.K[1, 1] + view.K[1, 2] + 0.5)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    ahead, z, column, row = (values[inside] for values in (ahead, z, column, row))
    depth = view.depth[row.astype(np.intp), column.astype(np.intp)].astype(np.float64)
    known = (depth > 0.0) & (depth < FARTHEST)
    across = (column - view.K[0, 2]) / view.K[0, 0]
    down = (row - view.K[1, 2]) / view.K[1, 1]
    along_ray = np.sqrt(1.0 + across * across + down * down)
    return ahead[known], ((depth - z) * along_ray)[known]
