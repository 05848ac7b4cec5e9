from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.camera import (
    Camera,
    Intrinsics,
    Renderer,
    deproject,
    project,
    zbuffer_to_depth,
)
from grasp_factory.core.geometry import Array, apply, look_at

SIZES = st.tuples(st.integers(16, 64), st.integers(16, 64))
FOVS = st.floats(math.radians(1.0), math.radians(170.0))
INTRINSICS = st.builds(lambda size, fov: Intrinsics.from_fov(*size, fov), SIZES, FOVS)
SAMPLED_AT = {Renderer.TINY: (0.0, 1.0), Renderer.EGL: (0.5, 0.5)}
"""Where each renderer samples pixel (0, 0), in pixels from the upper left corner."""
NEAR, FAR = 0.1, 4.0
CAMERA = Camera(
    "front",
    Intrinsics.from_fov(640, 480, math.radians(42.0)),
    look_at((1.15, 0.2, 0.58), (0.50, 0.0, 0.11)),
    NEAR,
    FAR,
)


def to_zbuffer(depth: Array, near: float, far: float) -> Array:
    """Return what OpenGL's projection makes of a depth: 0 at near, 1 at far."""
    return np.asarray(far * (depth - near) / (depth * (far - near)))


class TestIntrinsics:
    def test_the_upper_edge_of_the_view_is_half_the_angle_away(self) -> None:
        k = Intrinsics.from_fov(640, 480, math.radians(90.0))
        assert k.fx == k.fy == pytest.approx(240.0)

    @given(SIZES, FOVS, st.sampled_from(Renderer))
    def test_the_principal_point_is_the_middle_of_what_the_renderer_samples(
        self, size: tuple[int, int], fov: float, renderer: Renderer
    ) -> None:
        k, (dx, dy) = Intrinsics.from_fov(*size, fov, renderer), SAMPLED_AT[renderer]
        assert (k.cx + dx, k.cy + dy) == (k.width / 2, k.height / 2)

    def test_the_matrix_holds_the_intrinsics_in_their_places(self) -> None:
        K = Intrinsics(width=8, height=6, fx=10.0, fy=20.0, cx=3.0, cy=2.0).matrix()
        np.testing.assert_array_equal(K, [[10.0, 0.0, 3.0], [0.0, 20.0, 2.0], [0.0, 0.0, 1.0]])


class TestProjection:
    @given(INTRINSICS, st.integers(0, 2**32 - 1))
    def test_deprojected_pixels_project_back_to_themselves(self, k: Intrinsics, seed: int) -> None:
        depth = np.random.default_rng(seed).uniform(0.1, 5.0, (k.height, k.width))
        points = deproject(depth, k.matrix())
        v, u = np.indices(depth.shape)
        np.testing.assert_allclose(project(points, k.matrix()), np.stack([u, v], -1), atol=1e-9)
        np.testing.assert_array_equal(points[..., 2], depth)

    def test_the_principal_point_lies_on_the_optical_axis(self) -> None:
        k = CAMERA.intrinsics
        np.testing.assert_allclose(
            project(np.array([0.0, 0.0, 0.7]), k.matrix()), [k.cx, k.cy], atol=1e-12
        )

    def test_a_pixel_to_the_right_and_below_is_at_plus_x_and_plus_y(self) -> None:
        K = Intrinsics(width=5, height=5, fx=2.0, fy=4.0, cx=2.0, cy=2.0).matrix()
        points = deproject(np.full((5, 5), 0.5), K)
        np.testing.assert_allclose(points[3, 4], [0.5, 0.125, 0.5])

    def test_a_plane_across_the_axis_has_one_depth_and_even_spacing(self) -> None:
        k = CAMERA.intrinsics
        points = deproject(np.full((k.height, k.width), 0.5), k.matrix())
        np.testing.assert_array_equal(points[..., 2], 0.5)
        np.testing.assert_allclose(np.diff(points[..., 0], axis=1), 0.5 / k.fx)
        np.testing.assert_allclose(np.diff(points[..., 1], axis=0), 0.5 / k.fy)


class TestZBuffer:
    def test_zero_is_near_and_one_is_far(self) -> None:
        np.testing.assert_allclose(zbuffer_to_depth(np.array([0.0, 1.0]), NEAR, FAR), [NEAR, FAR])

    def test_depth_of_a_plane_at_half_a_metre_is_half_a_metre(self) -> None:
        # 4 * (0.5 - 0.1) / (0.5 * (4 - 0.1)), by hand
        assert zbuffer_to_depth(np.array(32.0 / 39.0), NEAR, FAR) == pytest.approx(0.5)

    @given(st.floats(0.01, 1.0), st.floats(1.5, 20.0), st.floats(0.0, 1.0))
    def test_metres_come_back_from_the_zbuffer(self, near: float, far: float, share: float) -> None:
        depth = np.array(near + share * (far - near))
        back = zbuffer_to_depth(to_zbuffer(depth, near, far), near, far)
        np.testing.assert_allclose(back, depth, rtol=1e-9)

    def test_the_shape_stays(self) -> None:
        assert zbuffer_to_depth(np.zeros((3, 4)), NEAR, FAR).shape == (3, 4)


class TestOpenGL:
    def test_the_view_has_up_positive_and_looks_along_minus_z(self) -> None:
        seen = apply(CAMERA.opengl_view(), np.array([0.50, 0.0, 0.11]))
        distance = math.dist((1.15, 0.2, 0.58), (0.50, 0.0, 0.11))
        np.testing.assert_allclose(seen, [0.0, 0.0, -distance], atol=1e-12)
        higher = apply(CAMERA.opengl_view(), np.array([0.50, 0.0, 0.2]))
        assert higher[1] > 0.0

    @given(
        st.floats(-0.5, 0.5),
        st.floats(-0.5, 0.5),
        st.floats(NEAR, FAR),
        st.sampled_from(Renderer),
        st.tuples(st.integers(0, 300), st.integers(0, 200)),
    )
    def test_the_renderer_draws_a_point_at_the_pixel_that_project_gives(
        self, x: float, y: float, depth: float, renderer: Renderer, corner: tuple[int, int]
    ) -> None:
        k = Intrinsics.from_fov(640, 480, math.radians(42.0), renderer)
        camera = dataclasses.replace(CAMERA, intrinsics=k, renderer=renderer)
        camera = camera.cropped(*corner, 320, 240)
        point = np.array([x * depth, y * depth, depth])  # camera frame
        world = apply(CAMERA.T_world_camera, point)
        clip = camera.opengl_projection() @ camera.opengl_view() @ [*world, 1.0]
        ndc = clip[:3] / clip[3]
        k, (dx, dy) = camera.intrinsics, SAMPLED_AT[renderer]
        # Clip space runs from the lower left (-1, -1) to the upper right (1, 1).
        grid = (ndc[0] + 1.0) / 2.0 * k.width, (1.0 - ndc[1]) / 2.0 * k.height
        pixel = grid[0] - dx, grid[1] - dy
        np.testing.assert_allclose(pixel, project(point, k.matrix()), atol=1e-8)
        zbuffer = np.array((ndc[2] + 1.0) / 2.0)
        np.testing.assert_allclose(zbuffer_to_depth(zbuffer, NEAR, FAR), depth, rtol=1e-9)

    def test_the_clipping_planes_are_at_minus_one_and_one(self) -> None:
        for depth, expected in ((NEAR, -1.0), (FAR, 1.0)):
            clip = CAMERA.opengl_projection() @ [0.0, 0.0, -depth, 1.0]
            assert clip[2] / clip[3] == pytest.approx(expected)
