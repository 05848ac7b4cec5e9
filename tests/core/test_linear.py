"""Small linear algebra against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.linear import (
    determinant,
    dot,
    length,
    norm,
    product,
    solve_definite,
    total,
    turned,
    turned_back,
)

RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("left", "right"),
    [((4, 4), (4, 4)), ((7, 3, 4, 4), (7, 3, 4, 4)), ((5, 6, 7), (5, 7, 6)), ((2, 3), (3, 5))],
)
def test_a_product_is_the_matrix_product(left, right):
    A, B = RNG.normal(size=left), RNG.normal(size=right)
    np.testing.assert_allclose(product(A, B), A @ B, rtol=1e-14, atol=1e-14)


def test_a_product_does_not_depend_on_the_layout_in_memory():
    A, B = RNG.normal(size=(3, 4, 4)), RNG.normal(size=(3, 4, 4))
    other = product(np.asfortranarray(A), np.asfortranarray(B))
    assert np.ascontiguousarray(other).tobytes() == product(A, B).tobytes()


def test_a_row_of_a_stack_is_what_it_is_alone():
    A, B = RNG.normal(size=(9, 6, 6)), RNG.normal(size=(9, 6, 6))
    assert product(A, B)[4].tobytes() == product(A[4], B[4]).tobytes()


@pytest.mark.parametrize(
    ("matrix", "vector"), [((3, 3), (5, 3)), ((5, 3, 3), (5, 3)), ((5, 3, 3), (3,))]
)
def test_vectors_are_turned_and_turned_back(matrix, vector):
    R, v = RNG.normal(size=matrix), RNG.normal(size=vector)
    np.testing.assert_allclose(turned(R, v), np.einsum("...ij,...j->...i", R, v), atol=1e-14)
    np.testing.assert_allclose(turned_back(R, v), np.einsum("...ji,...j->...i", R, v), atol=1e-14)


@given(st.lists(st.integers(-(10**6), 10**6), min_size=1, max_size=7))
def test_lengths_and_scalar_products(v):
    v = np.array(v) / 1000.0
    assert length(v) == pytest.approx(np.linalg.norm(v), rel=1e-14)
    assert norm(np.stack([v, 2.0 * v]))[1] == 2.0 * length(v)
    assert dot(v, v) == pytest.approx(v @ v, rel=1e-14)


def test_definite_systems_are_solved():
    J = RNG.normal(size=(40, 6, 7))
    A, x = J @ J.swapaxes(-1, -2) + 1e-10 * np.eye(6), RNG.normal(size=(40, 6))
    found = solve_definite(A, (A @ x[..., None])[..., 0])
    np.testing.assert_allclose(found, x, rtol=1e-8, atol=1e-8)


def test_a_system_near_singular_is_solved_as_well_as_lapack_does():
    J = RNG.normal(size=(6, 7))
    J[5] = J[4] + 1e-4 * J[5]
    A, b = J @ J.T + 1e-10 * np.eye(6), RNG.normal(size=6)
    residual = np.linalg.norm(A @ solve_definite(A, b) - b) / np.linalg.norm(b)
    assert residual < 1e-6


def test_solving_leaves_its_arguments_as_they_were():
    A, b = 2.0 * np.eye(3), np.ones(3)
    solve_definite(A, b)
    assert (A == 2.0 * np.eye(3)).all() and (b == 1.0).all()


def test_determinants_are_signed_volumes():
    A = RNG.normal(size=(20, 3, 3))
    np.testing.assert_allclose(determinant(A), np.linalg.det(A), rtol=1e-12)


def test_a_sum_is_the_same_on_every_python() -> None:
    assert total([0.1] * 10) == 0.9999999999999999  # 1.0 by sum() of Python 3.12 and newer
    assert total([]) == 0.0
