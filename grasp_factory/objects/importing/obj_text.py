"""The two OBJ files of an object: its collision and its visual shape. Runs in a child process."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from grasp_factory.core.geometry import Array
from grasp_factory.objects.obj_file import numbers_text

CREASE = np.radians(30.0)
"""Shading is not smoothed over edges that are sharper than this."""


def collision_text(hulls: Sequence[ConvexHull]) -> bytes:
    """Return an OBJ file with a group for each hull."""
    lines: list[str] = []
    first = 1
    for i, hull in enumerate(hulls):
        order = {int(old): new for new, old in enumerate(hull.vertices)}
        lines.append(f"o part_{i}")
        lines += _lines("v", hull.points[hull.vertices])
        for face, equation in zip(hull.simplices, hull.equations, strict=True):
            a, b, c = hull.points[face]
            outwards = np.dot(np.cross(b - a, c - a), equation[:3]) > 0.0
            corners = [order[int(v)] + first for v in (face if outwards else face[::-1])]
            lines.append("f {} {} {}".format(*corners))
        first += len(order)
    return ("\n".join(lines) + "\n").encode("ascii")


def visual_text(mesh: trimesh.Trimesh) -> bytes:
    """Return an OBJ file with normals, and texture coordinates projected along the nearest axis.

    A texture covers the object's largest side once.
    """
    low, size = mesh.bounds[0], float(mesh.extents.max())
    axes = np.abs(mesh.face_normals).argmax(axis=1)
    shares = (mesh.triangles - low) / size  # (m, 3, 3)
    others = np.array([[1, 2], [0, 2], [0, 1]])[axes]  # (m, 2)
    textures = np.take_along_axis(shares, others[:, None, :], axis=2).reshape(-1, 2)
    normals = _normals(mesh)
    v, at_v = _unique(mesh.vertices, 7)
    vt, at_vt = _unique(textures, 5)
    vn, at_vn = _unique(normals, 4)
    corners = np.stack([at_v[mesh.faces.reshape(-1)], at_vt, at_vn], axis=1) + 1
    lines = ["o seen", *_lines("v", v), *_lines("vt", vt), *_lines("vn", vn)]
    words = [f"{a}/{b}/{c}" for a, b, c in corners.tolist()]
    lines += [f"f {' '.join(words[i : i + 3])}" for i in range(0, len(words), 3)]
    return ("\n".join(lines) + "\n").encode("ascii")


def _normals(mesh: trimesh.Trimesh) -> Array:
    """Return a unit normal for each corner of each face, (3 m, 3), smooth except at creases."""
    smooth = mesh.face_adjacency[mesh.face_adjacency_angles < CREASE]
    groups = trimesh.graph.connected_component_labels(smooth, node_count=len(mesh.faces))
    corners = np.column_stack([groups.repeat(3), mesh.faces.reshape(-1)])
    rows, inverse = np.unique(corners, axis=0, return_inverse=True)
    flat = np.asarray(mesh.face_normals).repeat(3, axis=0)
    sums = np.zeros((len(rows), 3))
    np.add.at(sums, inverse.reshape(-1), flat * mesh.area_faces.repeat(3)[:, None])
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = (sums / np.maximum(lengths, 1e-300))[inverse.reshape(-1)]
    return np.where(np.abs(normals).sum(axis=1, keepdims=True) > 0.5, normals, flat)


def _unique(values: Array, decimals: int) -> tuple[Array, NDArray[np.intp]]:
    rows, inverse = np.unique(np.round(values, decimals) + 0.0, axis=0, return_inverse=True)
    return rows, inverse.reshape(-1)


def _lines(kind: str, values: Array) -> Iterable[str]:
    return (f"{kind} {numbers_text(row)}" for row in values.tolist())
