"""Shapes as text files for other tools, and what those tools know of them."""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import norm
from grasp_factory.core.triangle_mesh import TriangleMesh

_PAIRS = 1 << 22
"""Number of distances that are computed at once."""
_ROUNDING = 1e-9
"""Relative error of a distance, by far."""


def ply_text(mesh: TriangleMesh, center: Array) -> str:
    """Return a mesh as an ASCII PLY file in millimetres, with the origin at a point (3,) in metres.

    It has normals, the mean of the faces weighted by area, and the mesh's colour if it has one.
    Definition: http://paulbourke.net/dataformats/ply/
    """
    columns = [_numbers(1000.0 * (mesh.vertices - center), 4), _numbers(normals(mesh), 4)]
    names = [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    if mesh.color is not None:
        rgb = " ".join(str(round(255 * value)) for value in mesh.color)
        columns.append([rgb] * len(mesh.vertices))
        names += [f"property uchar {name}" for name in ("red", "green", "blue")]
    head = [
        *("ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}", *names),
        *(f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"),
        "end_header",
    ]
    vertices = [" ".join(row) for row in zip(*columns, strict=True)]
    faces = [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
    return "\n".join([*head, *vertices, *faces, ""])


def obj_file_text(mesh: TriangleMesh) -> str:
    """Return a mesh as an OBJ file, metres, in its own frame."""
    vertices = [f"v {row}" for row in _numbers(mesh.vertices, 6)]
    faces = [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    return "\n".join([*vertices, *faces, ""])


def xyz_text(points: Array) -> str:
    """Return points (K, 3) in metres as lines of three numbers."""
    return "\n".join([*_numbers(points, 6), ""])


def normals(mesh: TriangleMesh) -> Array:
    """Return the unit normal at each vertex, (V, 3); zeros where faces have no area."""
    a, b, c = mesh.vertices[mesh.faces.T]
    areas = np.cross(b - a, c - a)
    sums = np.zeros_like(mesh.vertices)
    for corner in mesh.faces.T:
        np.add.at(sums, corner, areas)
    lengths = norm(sums)[:, None]
    return np.divide(sums, lengths, out=np.zeros_like(sums), where=lengths > 0.0)


def diameter(points: Array) -> float:
    """Return the largest distance between any two of some points (K, 3), in their unit.

    Only points so far from the middle that they may be an end of it are compared in pairs.
    """
    radius = norm(points - (points.min(axis=0) + points.max(axis=0)) / 2.0)
    least = _farthest(points[radius.argmax()][None], points)
    outer = points[radius + radius.max() >= least * (1.0 - _ROUNDING)]
    rows = max(1, _PAIRS // len(outer))
    blocks = (outer[start : start + rows] for start in range(0, len(outer), rows))
    return max(_farthest(block, outer) for block in blocks)


def _farthest(block: Array, points: Array) -> float:
    squares = sum((block[:, None, k] - points[None, :, k]) ** 2 for k in range(3))
    return float(np.sqrt(np.max(squares)))


def surface_points(mesh: TriangleMesh, count: int) -> Array:
    """Return points (count, 3) that are drawn evenly from a mesh's surface, always the same."""
    rng = np.random.default_rng(0)
    a, b, c = mesh.vertices[mesh.faces.T]
    areas = norm(np.cross(b - a, c - a))
    face = rng.choice(len(areas), count, p=areas / areas.sum())
    u, v = rng.random((2, count, 1))
    is_beyond = u + v > 1.0
    u, v = np.where(is_beyond, 1.0 - u, u), np.where(is_beyond, 1.0 - v, v)
    points: Array = a[face] + u * (b - a)[face] + v * (c - a)[face]
    return points


def _numbers(rows: Array, decimals: int) -> list[str]:
    """Return rows of numbers as text with fixed decimals, never -0."""
    rounded = np.round(rows, decimals) + 0.0
    line = " ".join([f"%.{decimals}f"] * rows.shape[1]) + "\n"
    return (line * len(rows) % tuple(rounded.ravel().tolist())).splitlines()
