"""Linear algebra for small matrices, with identical bits on every processor.

BLAS and LAPACK choose kernels for the processor, and each kernel adds in a different order. Here
products are added one by one in the order of the index, with NumPy's elementwise operations, whose
results IEEE 754 defines. All code that computes stored bytes from a seed uses these functions.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def total(values: Iterable[float]) -> float:
    """Return the sum of numbers, added from the first to the last.

    From Python 3.12 on, ``sum`` adds floats with a compensation, which changes the last bit.
    """
    out = 0.0
    for value in values:
        out += value
    return out


def product(A: Array, B: Array) -> Array:
    """Return the matrix products (..., n, m) of stacks (..., n, k) and (..., k, m); k is small."""
    return np.asarray((A[..., :, :, None] * B[..., None, :, :]).sum(axis=-2))


def turned(R: Array, vectors: Array) -> Array:
    """Return the products (..., 3) of matrices (..., 3, 3) and vectors (..., 3).

    Leading dimensions broadcast: one matrix and many vectors, or many matrices and one vector.
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    rows = [R[..., i, 0] * x + R[..., i, 1] * y + R[..., i, 2] * z for i in range(3)]
    return np.stack(rows, axis=-1)


def turned_back(R: Array, vectors: Array) -> Array:
    """Return the products of the transposed matrices and vectors: ``turned(R^T, vectors)``."""
    return turned(np.swapaxes(R, -1, -2), vectors)


def dot(a: Array, b: Array) -> Array:
    """Return the scalar products (...) of vectors (..., n); n is small."""
    return np.asarray((a * b).sum(axis=-1))


def norm(vectors: ArrayLike) -> Array:
    """Return the lengths (...) of vectors (..., n); n is small."""
    v = np.asarray(vectors, np.float64)
    return np.sqrt(dot(v, v))


def length(vector: ArrayLike) -> float:
    """Return the length of one vector (n,); n is small."""
    return float(norm(vector))


def solve_definite(A: Array, b: Array) -> Array:
    """Return x (..., n) with ``A x = b`` for A (..., n, n) and b (..., n).

    A must be symmetric and positive definite: then Gauss-Jordan elimination needs no pivoting.
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
