"""Exact volume, centre of mass, inertia and bounding box of a body that consists of parts.

Everything is computed from the integrals of 1, r and r r' over the solid. The integrals of parts
add up. A change of coordinates x -> A x + t transforms them by the chain rule: the term in t is
the parallel-axis theorem, and the diagonal of A is the scale of a mesh.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from grasp_factory.core.geometry import Array, Pose, Vector3, apply, quat_xyzw_to_matrix, transform
from grasp_factory.core.linear import determinant, length, norm, product, total, turned
from grasp_factory.objects.base import Compound, Part
from grasp_factory.objects.obj_file import triangles

MAX_SWEEPS = 20
"""Limit for Jacobi's method, which needs about five sweeps for three axes."""
DIAGONAL = 1e-12
"""Off-diagonal terms below this share of the trace are rounding errors."""


@dataclass(frozen=True, slots=True)
class Moments:
    """Integrals over a solid of density 1."""

    volume: float
    """m3."""
    first: Array
    """Integral of r, (3,) m4."""
    second: Array
    """Integral of r r', (3, 3) m5."""

    def mapped(self, A: Array, t: Array) -> Moments:
        """Return the moments of the solid moved by x -> A x + t, where det A > 0."""
        stretch = float(determinant(A))
        first = stretch * turned(A, self.first)
        volume = stretch * self.volume
        mixed = _outer(first, t)
        second = stretch * product(product(A, self.second), A.T)
        second = second + mixed + mixed.T + volume * _outer(t, t)
        return Moments(volume, first + volume * t, second)


def _centred(volume: float, x: float, y: float, z: float) -> Moments:
    """Return moments about the centre of a solid with three planes of symmetry."""
    return Moments(volume, np.zeros(3), np.diag([x, y, z]))


BOX = _centred(1.0, 1 / 12, 1 / 12, 1 / 12)
BALL = _centred(math.pi / 6, *[math.pi / 120] * 3)
CYLINDER = _centred(math.pi / 4, math.pi / 64, math.pi / 64, math.pi / 48)
"""All three fill a box of 1 x 1 x 1. Mean square per axis: r2/5 for a ball, r2/4 for a disc."""


def polyhedron(faces: Array) -> Moments:
    """Return the moments of the solid inside a closed surface of triangles (n, 3, 3).

    Sums over the tetrahedra from the origin to each triangle (divergence theorem), with the
    integrals of F. Tonon, "Explicit exact formulas for the 3-D tetrahedron inertia tensor in
    terms of its vertex coordinates", J. Math. Stat. 1 (2005) 8-11.
    """
    volumes = determinant(faces) / 6.0
    sums = faces.sum(axis=1)
    outer = product(np.swapaxes(faces, -1, -2), faces) + _outer(sums, sums)
    return Moments(
        float(volumes.sum()),
        (volumes[:, None] * sums).sum(axis=0) / 4.0,
        (volumes[:, None, None] * outer).sum(axis=0) / 20.0,
    )


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def moments(parts: Sequence[Part]) -> Moments:
    """Return the moments of parts that do not overlap, about the object's origin."""
    moved = [
        _part_moments(part).mapped(
            quat_xyzw_to_matrix(part.pose.quat_xyzw), np.array(part.pose.position)
        )
        for part in parts
    ]
    return Moments(
        total(m.volume for m in moved),
        np.sum([m.first for m in moved], axis=0),
        np.sum([m.second for m in moved], axis=0),
    )


def _part_moments(part: Part) -> Moments:
    """Return a part's moments in its own frame."""
    unit = {"box": BOX, "sphere": BALL, "cylinder": CYLINDER}.get(part.shape)
    if part.shape == "capsule":
        return _capsule(part.size)
    return (unit or _mesh_moments(part.shape)).mapped(np.diag(part.size), np.zeros(3))


def _capsule(size: Vector3) -> Moments:
    """Return the moments of a cylinder along z between two hemispheres.

    The centroid of a hemisphere is 3/8 r from its disc.
    """
    r, h = size[0] / 2.0, size[2] - size[0]
    tube = CYLINDER.mapped(np.diag([2.0 * r, 2.0 * r, h]), np.zeros(3)) if h > 0.0 else None
    caps = BALL.mapped(np.diag([2.0 * r] * 3), np.zeros(3))
    apart = caps.volume * (h * h / 4.0 + h * 3.0 / 8.0 * r)
    volume, second = caps.volume, caps.second + np.diag([0.0, 0.0, apart])
    if tube:
        volume, second = volume + tube.volume, second + tube.second
    return Moments(volume, np.zeros(3), second)


@cache
def _mesh_moments(path: str) -> Moments:
    return polyhedron(triangles(Path(path)))


def compound(parts: tuple[Part, ...]) -> tuple[Compound, float]:
    """Return a body of parts that do not overlap, and its volume in m3."""
    whole = moments(parts)
    com = whole.first / whole.volume
    R, squares = principal_axes(whole.second / whole.volume - _outer(com, com))
    x, y, z = (float(square) for square in squares)
    body = Compound(
        parts=parts,
        inertial_frame=Pose.from_matrix(transform(R, com)),
        gyration_squared=(y + z, z + x, x + y),
    )
    return body, whole.volume


def principal_axes(covariance: Array) -> tuple[Array, Array]:
    """Return the rotation R (3, 3) and the values d (3,) with ``R diag(d) R' = covariance``.

    This is Jacobi's method with the smaller angle. A library's eigenvectors have any order and
    sign, and are arbitrary if two values are equal, as in half of all objects. Here an axis that
    is already principal does not change, on any machine.
    """
    D, R = covariance.copy(), np.eye(3)
    limit = DIAGONAL * float(np.trace(covariance))
    for _ in range(MAX_SWEEPS):
        if max(abs(D[0, 1]), abs(D[0, 2]), abs(D[1, 2])) <= limit:
            break
        for i, j in ((0, 1), (0, 2), (1, 2)):
            if abs(D[i, j]) <= limit:
                continue
            theta = (D[j, j] - D[i, i]) / (2.0 * D[i, j])
            tangent = math.copysign(1.0, theta) / (abs(theta) + length((theta, 1.0)))
            cosine = 1.0 / length((tangent, 1.0))
            turn = np.eye(3)
            turn[i, i] = turn[j, j] = cosine
            turn[i, j], turn[j, i] = tangent * cosine, -tangent * cosine
            D = product(product(turn.T, D), turn)
            R = product(R, turn)
    return R, np.diag(D)


def bounds(parts: Sequence[Part]) -> tuple[Vector3, Vector3]:
    """Return the corners of the tight bounding box in the object's frame, metres."""
    boxes = np.array([_part_bounds(part) for part in parts])
    lower, upper = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    return _vector(lower), _vector(upper)


def _part_bounds(part: Part) -> Array:
    """Return the corners (2, 3) of a part's bounding box in the object's frame."""
    T, half = part.pose.matrix(), np.array(part.size) / 2.0
    R, middle = T[:3, :3], T[:3, 3]
    if part.shape == "box":
        reach = turned(np.abs(R), half)
    elif part.shape == "sphere":
        reach = half
    elif part.shape == "capsule":
        reach = half[0] + (half[2] - half[0]) * np.abs(R[:, 2])
    elif part.shape == "cylinder":
        reach = half[0] * norm(R[:, :2]) + half[2] * np.abs(R[:, 2])
    else:
        corners = apply(T, _mesh_vertices(part.shape) * part.size)
        return np.array([corners.min(axis=0), corners.max(axis=0)])
    return np.array([middle - reach, middle + reach])


@cache
def _mesh_vertices(path: str) -> Array:
    return np.unique(triangles(Path(path)).reshape(-1, 3), axis=0)


def _vector(v: Array) -> Vector3:
    x, y, z = (float(a) for a in v)
    return x, y, z
