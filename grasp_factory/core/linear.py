"""Small linear algebra with the same bits on every processor.

BLAS and LAPACK choose kernels by the processor, and each sums in an order of its own. Here sums of
products are taken one by one, in the order of the index, by NumPy's elementwise operations, whose
results IEEE 754 fixes. Whatever leads from a seed to stored bytes uses these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def product(A: Array, B: Array) -> Array:
    """Return the matrix products (..., n, m) of stacks (..., n, k) and (..., k, m), of small k."""
    return np.asarray((A[..., :, :, None] * B[..., None, :, :]).sum(axis=-2))


def turned(R: Array, vectors: Array) -> Array:
    """Return the vectors (..., 3) that matrices (..., 3, 3) make of vectors (..., 3).

    One matrix for many vectors, a matrix for each, or many for one: shapes broadcast.
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    rows = [R[..., i, 0] * x + R[..., i, 1] * y + R[..., i, 2] * z for i in range(3)]
    return np.stack(rows, axis=-1)


def turned_back(R: Array, vectors: Array) -> Array:
    """Return what the transposed matrices make of vectors: ``turned(R^T, vectors)``."""
    return turned(np.swapaxes(R, -1, -2), vectors)


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products (...) of vectors (..., n), of small n."""
    return np.asarray((a * b).sum(axis=-1))


def norm(vectors: ArrayLike) -> Array:
    """Return the lengths (...) of vectors (..., n), of small n."""
    v = np.asarray(vectors, np.float64)
    return np.sqrt(dot(v, v))


def length(vector: ArrayLike) -> float:
    """Return the length of one vector (n,), of small n."""
    return float(norm(vector))


def solve_definite(A: Array, b: Array) -> Array:
    """Return x (..., n) with ``A x = b`` for A (..., n, n) and b (..., n).

    A is symmetric and positive definite: Gauss and Jordan's elimination needs no pivots then.
    """
    n = A.shape[-1]
    M = np.concatenate([A, b[..., None]], axis=-1)
    for k in range(n):
        row = M[..., k, k:] / M[..., k, k, None]
        M[..., :, k:] -= M[..., :, k, None] * row[..., None, :]
        M[..., k, k:] = row
    return M[..., n]


def determinant(A: Array) -> Array:
    """Return the determinants (...) of matrices (..., 3, 3)."""
    return dot(A[..., 0, :], np.cross(A[..., 1, :], A[..., 2, :]))
