"""A TSDF against scenes whose distances are known."""

from __future__ import annotations

import numpy as np
import pytest
from support.views import brick, photograph

from grasp_factory.core.config.cameras import CAMERAS
from grasp_factory.core.episode import CameraImage
from grasp_factory.core.geometry import Array, inverse, transform
from grasp_factory.signals.tsdf import DepthView, tsdf_grid

SIZE, R = 0.3, 40
VOXEL = SIZE / R
CORNER = np.array([0.40, -0.15, -0.05])
"""Of the cube, in the world; the table is z = 0."""
CENTRES = (np.arange(R) + 0.5) * VOXEL
BRICK = (0.12, 0.06, 0.09)
SCENE = brick(0.55, 0.02, 0.0, BRICK)


def seen(name: str) -> CameraImage:
    return photograph(CAMERAS[name].config, SCENE, (320, 240))


def view_of(image: CameraImage) -> DepthView:
    T_world_cube = transform(np.eye(3), CORNER)
    T_camera_cube = inverse(image.T_world_camera) @ T_world_cube
    return DepthView(depth=image.depth, K=image.intrinsics, T_camera_cube=T_camera_cube)


def surface(grid: Array, i: int, j: int) -> float:
    """Return the height over the table, metres, at which a column crosses 0.5 from above."""
    column = grid[i, j]
    k = int(np.flatnonzero((column[:-1] < 0.5) & (column[1:] >= 0.5) & (column[:-1] > 0.0))[-1])
    share = (0.5 - column[k]) / (column[k + 1] - column[k])
    return float(CENTRES[k] + share * VOXEL + CORNER[2])


def voxel(x: float, y: float) -> tuple[int, int]:
    i, j = np.floor((np.array([x, y]) - CORNER[:2]) / VOXEL).astype(int)
    return int(i), int(j)


@pytest.mark.parametrize("cameras", [("overhead",), ("overhead", "front")])
def test_the_table_and_the_top_of_a_brick_are_where_they_are(cameras: tuple[str, ...]) -> None:
    grid = tsdf_grid([view_of(seen(name)) for name in cameras], SIZE, R)
    assert surface(grid, *voxel(0.55, 0.02)) == pytest.approx(BRICK[2], abs=0.002)
    assert surface(grid, *voxel(0.55, -0.11)) == pytest.approx(0.0, abs=0.002)
    # Along x the brick is 0.12 m long, along y 0.06 m wide, and x is the grid's first index.
    heights = {at: surface(grid, *voxel(*at)) for at in [(0.59, 0.02), (0.55, 0.09)]}
    assert heights[(0.59, 0.02)] == pytest.approx(BRICK[2], abs=0.002)
    assert heights[(0.55, 0.09)] == pytest.approx(0.0, abs=0.002)


def test_values_grow_from_behind_the_surface_to_its_front_and_are_0_elsewhere() -> None:
    grid = tsdf_grid([view_of(seen("overhead"))], SIZE, R)
    column = grid[voxel(0.55, 0.02)]
    known = np.flatnonzero(column)
    assert (np.diff(column[known]) > 0.0).all()
    assert known.max() - known.min() + 1 == len(known) <= 8
    assert column.max() < 0.99
    assert grid.dtype == np.float32


@pytest.mark.parametrize("none", [0.0, np.nan, np.inf, 2.0, -1.0])
def test_a_view_without_depth_says_nothing(none: float) -> None:
    view = view_of(seen("overhead"))
    blind = DepthView(
        depth=np.full_like(view.depth, none), K=view.K, T_camera_cube=view.T_camera_cube
    )
    assert not tsdf_grid([blind], SIZE, R).any()
    assert not tsdf_grid([], SIZE, R).any()
    np.testing.assert_array_equal(tsdf_grid([view, blind], SIZE, R), tsdf_grid([view], SIZE, R))


def test_a_camera_that_looks_away_says_nothing() -> None:
    view = view_of(seen("overhead"))
    turned = transform(np.diag([1.0, -1.0, -1.0]), (0.0, 0.0, 0.0)) @ view.T_camera_cube
    away = DepthView(depth=view.depth, K=view.K, T_camera_cube=turned)
    assert not tsdf_grid([away], SIZE, R).any()
