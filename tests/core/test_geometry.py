from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from grasp_factory.core.geometry import (
    IDENTITY,
    Array,
    Pose,
    apply,
    inverse,
    look_at,
    matrix_to_quat_xyzw,
    quat_xyzw_to_matrix,
    rotation_about,
    rotation_vector,
    skew,
    transform,
)

UNIT = st.floats(-1.0, 1.0)
METRES = st.floats(-10.0, 10.0)
VECTORS = st.tuples(METRES, METRES, METRES)
AXES = st.tuples(UNIT, UNIT, UNIT).filter(lambda v: np.linalg.norm(v) > 0.1)
QUATS = st.tuples(UNIT, UNIT, UNIT, UNIT).filter(lambda q: np.linalg.norm(q) > 0.1)
ROTATIONS = QUATS.map(quat_xyzw_to_matrix)
TRANSFORMS = st.builds(transform, ROTATIONS, VECTORS)
TURNS = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0),
         "diagonal": (0.6, 0.0, 0.8), "opposite": (0.0, -0.8, -0.6)}  # fmt: skip


def unit(v: tuple[float, ...]) -> Array:
    return np.asarray(v) / np.linalg.norm(v)


def assert_rotation(R: Array) -> None:
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


class TestGroup:
    @given(TRANSFORMS, TRANSFORMS)
    def test_transforms_are_closed_under_composition(self, T_a_b: Array, T_b_c: Array) -> None:
        T_a_c = T_a_b @ T_b_c
        assert_rotation(T_a_c[:3, :3])
        np.testing.assert_array_equal(T_a_c[3], [0.0, 0.0, 0.0, 1.0])

    @given(TRANSFORMS)
    def test_the_inverse_undoes_on_both_sides(self, T: Array) -> None:
        np.testing.assert_allclose(T @ inverse(T), np.eye(4), atol=1e-12)
        np.testing.assert_allclose(inverse(T) @ T, np.eye(4), atol=1e-12)

    @given(TRANSFORMS, TRANSFORMS)
    def test_the_inverse_of_a_product_is_the_reversed_product(self, A: Array, B: Array) -> None:
        np.testing.assert_allclose(inverse(A @ B), inverse(B) @ inverse(A), atol=1e-11)

    @given(TRANSFORMS, TRANSFORMS, TRANSFORMS)
    def test_composition_is_associative(self, A: Array, B: Array, C: Array) -> None:
        np.testing.assert_allclose((A @ B) @ C, A @ (B @ C), atol=1e-11)

    def test_the_identity_pose_is_the_identity_matrix(self) -> None:
        np.testing.assert_array_equal(IDENTITY.matrix(), np.eye(4))

    @given(TRANSFORMS, TRANSFORMS)
    def test_a_stack_is_inverted_one_by_one(self, A: Array, B: Array) -> None:
        stack = np.stack([[A, B], [B, A]])
        expected = np.stack([[inverse(A), inverse(B)], [inverse(B), inverse(A)]])
        np.testing.assert_array_equal(inverse(stack), expected)

    @given(TRANSFORMS)
    def test_inverting_leaves_the_argument_alone(self, T: Array) -> None:
        before = T.copy()
        inverse(T)
        np.testing.assert_array_equal(T, before)


class TestApply:
    @given(TRANSFORMS, TRANSFORMS, VECTORS)
    def test_applying_a_product_is_applying_one_after_the_other(
        self, T_a_b: Array, T_b_c: Array, point: tuple[float, ...]
    ) -> None:
        p = np.array(point)
        np.testing.assert_allclose(
            apply(T_a_b @ T_b_c, p), apply(T_a_b, apply(T_b_c, p)), atol=1e-10
        )

    def test_the_origin_goes_to_the_position_and_x_to_the_first_column(self) -> None:
        T = transform(rotation_about((0.0, 0.0, 1.0), np.pi / 2), (1.0, 2.0, 3.0))
        np.testing.assert_allclose(apply(T, np.zeros(3)), [1.0, 2.0, 3.0])
        np.testing.assert_allclose(apply(T, np.array([1.0, 0.0, 0.0])), [1.0, 3.0, 3.0])

    def test_points_keep_their_shape(self) -> None:
        points = np.arange(24.0).reshape(2, 4, 3)
        T = transform(np.eye(3), (1.0, 0.0, 0.0))
        np.testing.assert_array_equal(apply(T, points), points + np.array([1.0, 0.0, 0.0]))


class TestQuaternions:
    @given(QUATS)
    def test_a_quaternion_comes_back_from_its_matrix(self, quat: tuple[float, ...]) -> None:
        expected = unit(quat)
        back = matrix_to_quat_xyzw(quat_xyzw_to_matrix(quat))
        assert back[3] >= 0.0
        np.testing.assert_allclose(back * np.sign(back @ expected), expected, atol=1e-9)

    @given(ROTATIONS)
    def test_a_matrix_comes_back_from_its_quaternion(self, R: Array) -> None:
        assert_rotation(R)
        np.testing.assert_allclose(quat_xyzw_to_matrix(matrix_to_quat_xyzw(R)), R, atol=1e-12)

    @pytest.mark.parametrize("off", [0.0, 1e-15, -1e-15, 1e-9, -1e-9, 1e-4])
    @pytest.mark.parametrize("axis", TURNS.values(), ids=TURNS)
    def test_half_turns_come_back(self, axis: tuple[float, ...], off: float) -> None:
        R = rotation_about(axis, np.pi + off)
        quat = matrix_to_quat_xyzw(R)
        assert np.linalg.norm(quat) == pytest.approx(1.0)
        np.testing.assert_allclose(quat_xyzw_to_matrix(quat), R, atol=1e-14)

    def test_the_scalar_is_last(self) -> None:
        quarter = matrix_to_quat_xyzw([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(quarter, [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])

    @given(QUATS, st.floats(0.1, 10.0))
    def test_the_length_of_a_quaternion_does_not_matter(
        self, quat: tuple[float, ...], length: float
    ) -> None:
        scaled = quat_xyzw_to_matrix(np.asarray(quat) * length)
        np.testing.assert_allclose(scaled, quat_xyzw_to_matrix(quat), atol=1e-12)

    @given(TRANSFORMS)
    def test_a_pose_is_plain_and_gives_its_matrix_back(self, T: Array) -> None:
        pose = Pose.from_matrix(T)
        assert {type(v) for v in (*pose.position, *pose.quat_xyzw)} == {float}
        assert hash(pose) == hash(Pose.from_matrix(T))
        np.testing.assert_allclose(pose.matrix(), T, atol=1e-12)


class TestRotationVectors:
    @given(AXES, st.floats(0.0, np.pi - 1e-6))
    def test_the_rotation_vector_is_axis_times_angle(
        self, axis: tuple[float, ...], angle: float
    ) -> None:
        vector = rotation_vector(rotation_about(unit(axis), angle))
        np.testing.assert_allclose(vector, unit(axis) * angle, atol=1e-9)

    @given(ROTATIONS)
    def test_turning_by_the_rotation_vector_gives_the_rotation(self, R: Array) -> None:
        vector = rotation_vector(R)
        angle = float(np.linalg.norm(vector))
        assert angle <= np.pi + 1e-12
        assume(angle > 1e-9)
        np.testing.assert_allclose(rotation_about(vector / angle, angle), R, atol=1e-9)

    @pytest.mark.parametrize("axis", TURNS.values(), ids=TURNS)
    def test_a_half_turn_is_pi_about_the_axis_or_its_opposite(
        self, axis: tuple[float, ...]
    ) -> None:
        vector = rotation_vector(rotation_about(axis, np.pi))
        assert np.linalg.norm(vector) == pytest.approx(np.pi)
        assert abs(vector @ axis) == pytest.approx(np.pi)

    def test_more_than_half_a_turn_is_less_the_other_way(self) -> None:
        vector = rotation_vector(rotation_about((0.0, 0.0, 1.0), 1.5 * np.pi))
        np.testing.assert_allclose(vector, [0.0, 0.0, -0.5 * np.pi], atol=1e-12)

    def test_no_turn_is_zero(self) -> None:
        np.testing.assert_array_equal(rotation_vector(np.eye(3)), np.zeros(3))

    @pytest.mark.parametrize("angle", [1e-6, 1e-10, 1e-13])
    def test_tiny_turns_keep_their_size(self, angle: float) -> None:
        vector = rotation_vector(rotation_about((0.0, 1.0, 0.0), angle))
        np.testing.assert_allclose(vector, [0.0, angle, 0.0], rtol=1e-6, atol=0.0)

    def test_a_quarter_turn_about_z_takes_x_to_y(self) -> None:
        R = rotation_about((0.0, 0.0, 1.0), np.pi / 2)
        np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)

    @given(VECTORS, VECTORS)
    def test_skew_is_the_cross_product(self, a: tuple[float, ...], b: tuple[float, ...]) -> None:
        np.testing.assert_allclose(skew(np.array(a)) @ b, np.cross(a, b), atol=1e-12)


class TestLookAt:
    @given(VECTORS, VECTORS)
    def test_it_is_a_rigid_camera_with_the_target_straight_ahead(
        self, eye: tuple[float, ...], target: tuple[float, ...]
    ) -> None:
        way = np.subtract(target, eye)
        assume(np.linalg.norm(way[:2]) > 1e-3)
        T_world_camera = look_at(eye, target)
        assert_rotation(T_world_camera[:3, :3])
        seen = apply(inverse(T_world_camera), np.array(target))
        np.testing.assert_allclose(seen, [0.0, 0.0, np.linalg.norm(way)], atol=1e-9)

    @given(VECTORS, VECTORS)
    def test_the_horizon_is_level(self, eye: tuple[float, ...], target: tuple[float, ...]) -> None:
        assume(np.linalg.norm(np.subtract(target, eye)[:2]) > 1e-3)
        right, down = look_at(eye, target)[:3, :2].T
        assert right[2] == pytest.approx(0.0, abs=1e-12)
        assert down[2] < 0.0

    def test_what_is_right_appears_right_and_what_is_lower_appears_lower(self) -> None:
        # From the robot's front looking back at it, the world's +y is on the right-hand side.
        T_camera_world = inverse(look_at((2.0, 0.0, 0.5), (0.0, 0.0, 0.5)))
        right = apply(T_camera_world, np.array([0.0, 0.3, 0.5]))
        lower = apply(T_camera_world, np.array([0.0, 0.0, 0.1]))
        np.testing.assert_allclose(right, [0.3, 0.0, 2.0], atol=1e-12)
        np.testing.assert_allclose(lower, [0.0, 0.4, 2.0], atol=1e-12)

    def test_straight_down_needs_another_up(self) -> None:
        with pytest.raises(ValueError, match=r"no camera looks from .* with up .*: change up"):
            look_at((0.5, 0.0, 1.0), (0.5, 0.0, 0.0))
        T_world_camera = look_at((0.5, 0.0, 1.0), (0.5, 0.0, 0.0), up=(1.0, 0.0, 0.0))
        forward_of_the_robot = T_world_camera[:3, :3].T @ [1.0, 0.0, 0.0]
        np.testing.assert_allclose(forward_of_the_robot, [0.0, -1.0, 0.0], atol=1e-12)

    def test_an_eye_at_its_target_sees_nothing(self) -> None:
        with pytest.raises(ValueError, match="no camera looks from"):
            look_at((0.1, 0.2, 0.3), (0.1, 0.2, 0.3))

    def test_the_arguments_are_left_alone(self) -> None:
        eye, target = np.array([1.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.0])
        look_at(eye, target)
        np.testing.assert_array_equal(eye, [1.0, 0.0, 1.0])
        np.testing.assert_array_equal(target, [0.0, 0.0, 0.0])
