from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp_factory.core.geometry import (
    IDENTITY,
    Array,
    Pose,
    apply,
    inverse,
    quat_xyzw_to_matrix,
)
from grasp_factory.objects import Compound, Part
from grasp_factory.objects.procedural import FAMILIES, PROCEDURAL
from grasp_factory.objects.solids import bounds, compound, moments, principal_axes
from grasp_factory.objects.unit_meshes import ROUND, mesh_file

VOXELS = 48
"""Along each side of the bounding box."""

lengths = st.floats(0.01, 0.2)
coordinates = st.floats(-0.2, 0.2)
quats = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
poses = st.builds(
    lambda position, quat: Pose(position, tuple(np.array(quat) / np.linalg.norm(quat))),
    st.tuples(coordinates, coordinates, coordinates),
    quats,
)
families = pytest.mark.parametrize("family", FAMILIES)


def part(shape: str, *size: float, pose: Pose = IDENTITY) -> Part:
    x, y, z = size
    return Part(shape=shape, size=(x, y, z), pose=pose)


def body_of(family: str, number: int = 0) -> Compound:
    body = PROCEDURAL.model(f"procedural/{family}/{number}").body
    assert isinstance(body, Compound)
    return body


def moved(parts: tuple[Part, ...], T: Array) -> tuple[Part, ...]:
    return tuple(
        Part(shape=p.shape, size=p.size, pose=Pose.from_matrix(T @ p.pose.matrix())) for p in parts
    )


def solids_of(path: str) -> list[tuple[Array, Array]]:
    """Read each group of an OBJ file as half-spaces: normals (n, 3) and offsets (n,)."""
    vertices, groups = [], []
    for line in Path(path).read_text(encoding="ascii").splitlines():
        kind, *words = line.split()
        if kind == "v":
            vertices.append([float(word) for word in words])
        elif kind == "o":
            groups.append([])
        elif kind == "f":
            groups[-1].append([int(word.split("/")[0]) - 1 for word in words[:3]])
    solids = []
    for faces in groups:
        a, b, c = np.moveaxis(np.array(vertices)[np.array(faces)], 1, 0)
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        solids.append((normals, (normals * a).sum(axis=1)))
    return solids


def insides(part: Part, points: Array, skin: float = 0.0) -> list[NDArray[np.bool_]]:
    """Return for each convex solid of a part which points lie in it, deeper than ``skin``.

    The skin is a share of the part's size.
    """
    x, y, z = (apply(inverse(part.pose.matrix()), points) / part.size).T
    half, r2 = 0.5 - skin, (0.5 - skin) ** 2
    if part.shape == "box":
        return [(abs(x) < half) & (abs(y) < half) & (abs(z) < half)]
    if part.shape == "sphere":
        return [x**2 + y**2 + z**2 < r2]
    if part.shape == "cylinder":
        return [(x**2 + y**2 < r2) & (abs(z) < half)]
    if part.shape == "capsule":
        long = part.size[2] / part.size[0]
        beyond = np.maximum(abs(z) * long - (long - 1.0) / 2.0, 0.0)
        return [x**2 + y**2 + beyond**2 < r2]
    local = np.column_stack([x, y, z])
    return [
        (local @ normals.T < offsets - skin).all(axis=1)
        for normals, offsets in solids_of(part.shape)
    ]


def voxels(parts: tuple[Part, ...]) -> tuple[Array, float]:
    """Return a point (n, 3) in each small box of those that fill the bounding one, and its volume.

    The points are drawn: the middles would all miss, or all hit, what lies between two layers.
    """
    lower, upper = (np.array(corner) for corner in bounds(parts))
    corners = np.stack(np.indices((VOXELS, VOXELS, VOXELS)), axis=-1).reshape(-1, 3)
    shares = (corners + np.random.default_rng(0).random(corners.shape)) / VOXELS
    return lower + shares * (upper - lower), float((upper - lower).prod()) / VOXELS**3


def inertia(body: Compound) -> Array:
    """Return the inertia over the mass, (3, 3) m2, along the object's axes."""
    R = body.inertial_frame.matrix()[:3, :3]
    return np.asarray(R @ np.diag(body.gyration_squared) @ R.T)


class TestClosedForms:
    """Volume and moments about the middle, from a textbook's table."""

    @given(lengths, lengths, lengths)
    def test_box(self, a: float, b: float, c: float) -> None:
        body, volume = compound((part("box", a, b, c),))
        assert volume == pytest.approx(a * b * c)
        expected = [(b * b + c * c) / 12, (a * a + c * c) / 12, (a * a + b * b) / 12]
        np.testing.assert_allclose(body.gyration_squared, expected, rtol=1e-12)

    @given(lengths)
    def test_sphere(self, d: float) -> None:
        body, volume = compound((part("sphere", d, d, d),))
        assert volume == pytest.approx(4 / 3 * math.pi * (d / 2) ** 3)
        np.testing.assert_allclose(body.gyration_squared, [0.4 * (d / 2) ** 2] * 3, rtol=1e-12)

    @given(lengths, lengths)
    def test_cylinder(self, d: float, h: float) -> None:
        body, volume = compound((part("cylinder", d, d, h),))
        r = d / 2
        assert volume == pytest.approx(math.pi * r * r * h)
        across = (3 * r * r + h * h) / 12
        np.testing.assert_allclose(body.gyration_squared, [across, across, r * r / 2], rtol=1e-12)

    @given(lengths, st.floats(0.0, 0.2))
    def test_capsule(self, d: float, h: float) -> None:
        body, volume = compound((part("capsule", d, d, d + h),))
        r = d / 2
        tube, caps = math.pi * r * r * h, 4 / 3 * math.pi * r**3
        assert volume == pytest.approx(tube + caps)
        along = tube * r * r / 2 + caps * 0.4 * r * r
        across = tube * (r * r / 4 + h * h / 12) + caps * (0.4 * r * r + h * h / 4 + 3 / 8 * h * r)
        expected = np.array([across, across, along]) / volume
        np.testing.assert_allclose(body.gyration_squared, expected, rtol=1e-9)

    @given(lengths, lengths, lengths)
    def test_a_box_of_triangles_is_a_box(self, a: float, b: float, c: float) -> None:
        ours, volume = compound((part(mesh_file("box"), a, b, c),))
        true, expected = compound((part("box", a, b, c),))
        assert volume == pytest.approx(expected)
        np.testing.assert_allclose(ours.gyration_squared, true.gyration_squared, rtol=1e-12)
        np.testing.assert_allclose(ours.inertial_frame.position, 0.0, atol=1e-15)

    @given(lengths, lengths, lengths)
    def test_a_wedge_of_triangles_is_half_a_box(self, a: float, b: float, c: float) -> None:
        body, volume = compound((part(mesh_file("wedge"), a, b, c),))
        assert volume == pytest.approx(a * b * c / 2)
        com = np.array(body.inertial_frame.position)
        np.testing.assert_allclose(com, [-a / 6, -b / 6, 0.0], atol=1e-15)
        assert inertia(body)[2, 2] == pytest.approx((a * a + b * b) / 18)
        assert inertia(body)[0, 1] == pytest.approx(a * b / 36)

    def test_a_round_mesh_is_its_polygon_and_not_the_circle(self) -> None:
        _, volume = compound((part(mesh_file("cylinder"), 2.0, 2.0, 1.0),))
        assert volume == pytest.approx(ROUND / 2 * math.sin(2 * math.pi / ROUND), rel=1e-6)

    def test_a_cone_without_its_tip_has_the_textbooks_centroid(self) -> None:
        body, volume = compound((part(mesh_file("frustum_60"), 2.0, 2.0, 1.0),))
        polygon = ROUND / 2 * math.sin(2 * math.pi / ROUND)
        assert volume == pytest.approx(polygon * (1 + 0.6 + 0.36) / 3, rel=1e-6)
        height = (1 + 2 * 0.6 + 3 * 0.36) / (4 * (1 + 0.6 + 0.36))
        assert body.inertial_frame.position[2] == pytest.approx(height - 0.5, rel=1e-6)


@families
class TestFamilies:
    @pytest.mark.slow
    def test_volume_center_and_inertia_are_those_of_the_voxels_inside(self, family: str) -> None:
        body = body_of(family)
        points, each = voxels(body.parts)
        inside = np.any([i for p in body.parts for i in insides(p, points)], axis=0)
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        points = points[inside]
        com = points.mean(axis=0)
        spread = np.cov(points.T, bias=True)
        assert moments(body.parts).volume == pytest.approx(inside.sum() * each, rel=0.01)
        np.testing.assert_allclose(body.inertial_frame.position, com, atol=0.001 * extent)
        expected = np.eye(3) * np.trace(spread) - spread
        np.testing.assert_allclose(inertia(body), expected, atol=0.01 * np.trace(spread))

    @pytest.mark.slow
    def test_parts_do_not_overlap(self, family: str) -> None:
        for number in range(3):
            body = body_of(family, number)
            points, _ = voxels(body.parts)
            depth = np.sum([i for p in body.parts for i in insides(p, points, 1e-5)], axis=0)
            assert depth.max() == 1, number

    def test_moments_of_inertia_are_those_of_a_real_body(self, family: str) -> None:
        for number in range(20):
            a, b, c = sorted(body_of(family, number).gyration_squared)
            assert a > 0.0
            assert a + b > c

    def test_another_pose_of_all_parts_moves_the_center_and_keeps_the_rest(
        self, family: str
    ) -> None:
        body = body_of(family)
        T = Pose((0.3, -0.2, 0.1), (0.1, 0.7, -0.5, 0.5)).matrix()
        other, volume = compound(moved(body.parts, T))
        assert volume == pytest.approx(moments(body.parts).volume)
        expected = apply(T, np.array(body.inertial_frame.position))
        np.testing.assert_allclose(other.inertial_frame.position, expected, atol=1e-12)
        turned = T[:3, :3] @ inertia(body) @ T[:3, :3].T
        np.testing.assert_allclose(inertia(other), turned, atol=1e-14)

    def test_the_inertial_frame_lies_in_the_bounding_box(self, family: str) -> None:
        for number in range(20):
            body = body_of(family, number)
            lower, upper = bounds(body.parts)
            com = np.array(body.inertial_frame.position)
            assert ((com > lower) & (com < upper)).all()


class TestPrincipalAxes:
    @given(quats, lengths, lengths, lengths)
    def test_they_make_the_tensor_diagonal_and_are_right_handed(
        self, quat: tuple[float, ...], a: float, b: float, c: float
    ) -> None:
        turn = quat_xyzw_to_matrix(quat)
        covariance = turn @ np.diag([a, b, c]) @ turn.T
        R, values = principal_axes(covariance)
        np.testing.assert_allclose(R @ np.diag(values) @ R.T, covariance, atol=1e-12)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        np.testing.assert_allclose(np.sort(values), np.sort([a, b, c]), atol=1e-12)

    @given(lengths, lengths)
    def test_axes_that_are_principal_already_stay(self, a: float, b: float) -> None:
        R, values = principal_axes(np.diag([a, b, a]))
        np.testing.assert_array_equal(R, np.eye(3))
        np.testing.assert_array_equal(values, [a, b, a])

    def test_equal_values_off_the_axes_do_not_turn_a_ring(self) -> None:
        for family in ("bottle", "cross", "cylinder", "dumbbell", "frustum", "ring", "sphere"):
            assert body_of(family).inertial_frame.quat_xyzw == (0.0, 0.0, 0.0, 1.0)


class TestBounds:
    @given(st.sampled_from(["box", "sphere", "cylinder", "capsule"]), lengths, lengths, poses)
    def test_they_touch_the_surface_of_a_turned_primitive(
        self, shape: str, d: float, long: float, pose: Pose
    ) -> None:
        size = {"sphere": (d, d, d), "capsule": (d, d, d + long)}.get(shape, (d, d, long))
        solid = part(shape, *size, pose=pose)
        box = np.array(bounds((solid,)))
        for axis in range(3):
            for side in range(2):
                direction = np.zeros(3)
                direction[axis] = 2 * side - 1
                reach = support(solid, direction)
                assert box[side, axis] * direction[axis] == pytest.approx(reach, abs=1e-12)

    @given(poses)
    def test_those_of_a_mesh_are_those_of_its_vertices(self, pose: Pose) -> None:
        lower, upper = bounds((part(mesh_file("box"), 0.1, 0.2, 0.3, pose=pose),))
        np.testing.assert_allclose(
            [lower, upper], bounds((part("box", 0.1, 0.2, 0.3, pose=pose),)), atol=1e-12
        )

    def test_those_of_several_parts_hold_all_of_them(self) -> None:
        parts = (
            part("box", 0.1, 0.1, 0.1),
            part("sphere", 0.1, 0.1, 0.1, pose=Pose((0.2, 0.0, 0.0), IDENTITY.quat_xyzw)),
        )
        assert bounds(parts) == ((-0.05, -0.05, -0.05), (0.25, 0.05, 0.05))


def support(solid: Part, direction: Array) -> float:
    """Return how far a primitive reaches along a unit direction, metres from the origin."""
    T, (d, _, long) = solid.pose.matrix(), solid.size
    x, y, z = T[:3, :3].T @ direction
    reach = {
        "box": (d * abs(x) + d * abs(y) + long * abs(z)) / 2,
        "sphere": d / 2,
        "cylinder": (d * math.sqrt(max(0.0, 1 - z * z)) + long * abs(z)) / 2,
        "capsule": (d + (long - d) * abs(z)) / 2,
    }[solid.shape]
    return float(T[:3, 3] @ direction + reach)
