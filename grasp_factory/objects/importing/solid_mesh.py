"""Make a solid from the triangles of a file, if possible. Runs in the child process."""

from __future__ import annotations

import fast_simplification
import numpy as np
import trimesh
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.objects.importing.base import UnusableError

MAX_FACES = 8_000
"""Faces of the mesh to render and decompose; on an object of 100 mm, edges are about 2 mm long."""
MAX_BODIES = 64
"""Largest number of separate closed surfaces that are treated one by one."""
DUST = 0.02
"""Share of the largest side: smaller pieces among larger ones are scanner noise."""
BENDS_FACES = 2_000
PROBES = 32
"""Corners of a surface that are tested to be inside another one."""


def tidied(vertices: Array, faces: NDArray[np.int64]) -> tuple[trimesh.Trimesh, bool]:
    """Merge duplicate vertices and faces, close small holes, make the winding consistent.

    Args:
        vertices: (n, 3) metres, finite.
        faces: (m, 3).

    Returns:
        The mesh, and whether it is closed only because holes were filled.

    Raises:
        UnusableError: if nothing is left of it.
    """
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    if size <= 0.0:
        raise UnusableError("all its vertices are one point")
    # Tolerances are absolute, so each mesh is scaled to one unit.
    mesh = trimesh.Trimesh((vertices - low) / size, faces, process=False)
    _merge(mesh)
    if len(mesh.faces) > MAX_FACES:
        mesh = _simplified(mesh, MAX_FACES)
        _merge(mesh)
    if len(mesh.faces) < 4:
        raise UnusableError("its faces have no area")
    was_closed = bool(mesh.is_watertight)
    if not was_closed:
        trimesh.repair.fill_holes(mesh)
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
    mended = not was_closed and bool(mesh.is_watertight)
    return trimesh.Trimesh(mesh.vertices * size + low, mesh.faces, process=False), mended


def closed_bodies(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Return the separate solids of a mesh, without cavities; none if it is not closed.

    This turns the faces of ``mesh`` itself outwards, those of a cavity inwards.
    """
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return []
    labels = face_parts(mesh)
    count = int(labels.max()) + 1
    if count > MAX_BODIES:
        return []
    faces = mesh.faces.copy()
    bodies = [mesh.submesh([np.flatnonzero(labels == i)], append=True) for i in range(count)]
    solids = []
    for i, body in enumerate(bodies):
        others = [other for j, other in enumerate(bodies) if j != i]
        if body.volume >= 0.0:
            solids.append(body)
        elif not any(_contains(other, body) for other in others):
            body.invert()
            faces[labels == i] = faces[labels == i][:, ::-1]
            solids.append(body)
    mesh.faces = faces
    return solids


def face_parts(mesh: trimesh.Trimesh) -> NDArray[np.int64]:
    """Return for each face the index of its connected component."""
    labels = trimesh.graph.connected_component_labels(
        mesh.face_adjacency, node_count=len(mesh.faces)
    )
    return np.asarray(labels, np.int64)


def bends(mesh: trimesh.Trimesh) -> float:
    """Return how much a mesh bends: sum of angle times length of its edges, over its largest side.

    It is twice the integral of the mean curvature; 13 for a ball of any size. The mesh is first
    simplified to at most ``BENDS_FACES`` faces, so that scanner noise has little effect.
    """
    coarse = trimesh.Trimesh(mesh.vertices / mesh.extents.max(), mesh.faces, process=False)
    if len(mesh.faces) > BENDS_FACES:
        coarse = _simplified(coarse, BENDS_FACES)
    ends = coarse.vertices[coarse.face_adjacency_edges]
    lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return float((coarse.face_adjacency_angles * lengths).sum())


def without_dust(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh without the pieces that are tiny compared with the whole."""
    labels = face_parts(mesh)
    low = np.full((int(labels.max()) + 1, 3), np.inf)
    high = -low
    np.minimum.at(low, labels, mesh.triangles.min(axis=1))
    np.maximum.at(high, labels, mesh.triangles.max(axis=1))
    large = (high - low).max(axis=1) >= DUST * float(mesh.extents.max())
    if large.all() or not large.any():
        return mesh
    return mesh.submesh([np.flatnonzero(large[labels])], append=True)


def _contains(outer: trimesh.Trimesh, inner: trimesh.Trimesh) -> bool:
    low, high = outer.bounds
    if not ((low < inner.bounds[0]).all() and (inner.bounds[1] < high).all()):
        return False
    points = inner.vertices[:: max(1, len(inner.vertices) // PROBES)]
    return all(abs(_turns(outer.triangles, point)) > 0.5 for point in points)


def _turns(triangles: Array, point: Array) -> float:
    """Return the winding number of a closed surface (n, 3, 3): 0 outside, 1 or -1 inside.

    The solid angles are those of A. van Oosterom and J. Strackee, IEEE Trans. Biomed. Eng. 30
    (1983) 125-126.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a)))
    angles = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return float(angles.sum()) / (2.0 * np.pi)


def _simplified(mesh: trimesh.Trimesh, faces: int) -> trimesh.Trimesh:
    points, triangles = fast_simplification.simplify(
        np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int32), target_count=faces
    )
    return trimesh.Trimesh(points, triangles, process=False)


def _merge(mesh: trimesh.Trimesh) -> None:
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
