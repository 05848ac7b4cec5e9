"""Making a solid of the triangles in a file, as far as that goes. Runs in the child process."""

from __future__ import annotations

import fast_simplification
import numpy as np
import trimesh
from numpy.typing import NDArray

from grasp_factory.geometry import Array
from grasp_factory.meshes.base import UnusableError

MAX_FACES = 8_000
"""Of what is seen and decomposed: on an object of 100 mm the edges have about 2 mm."""
MAX_BODIES = 24
"""Separate closed surfaces that are looked at one by one."""


def tidied(vertices: Array, faces: NDArray[np.int64]) -> tuple[trimesh.Trimesh, bool]:
    """Merge double vertices and faces, close small holes, turn all faces to one side.

    Args:
        vertices: (n, 3) metres, finite.
        faces: (m, 3).

    Returns:
        The mesh, and whether it is closed only because holes were.

    Raises:
        UnusableError: if nothing is left of it.
    """
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max())
    if size <= 0.0:
        raise UnusableError("all its vertices are one point")
    # Tolerances are absolute: a mesh of one unit has them at the same place as any other.
    mesh = trimesh.Trimesh((vertices - low) / size, faces, process=False)
    _merge(mesh)
    if len(mesh.faces) > MAX_FACES:
        points, triangles = fast_simplification.simplify(
            np.asarray(mesh.vertices, np.float64),
            np.asarray(mesh.faces, np.int32),
            target_count=MAX_FACES,
        )
        mesh = trimesh.Trimesh(points, triangles, process=False)
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
    """Return the separate solids of a mesh, a cavity left out; none where it is not closed.

    The mesh's own faces are turned outwards, those of a cavity inwards.
    """
    if not (mesh.is_watertight and mesh.is_winding_consistent):
        return []
    labels = trimesh.graph.connected_component_labels(
        mesh.face_adjacency, node_count=len(mesh.faces)
    )
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


def _contains(outer: trimesh.Trimesh, inner: trimesh.Trimesh) -> bool:
    low, high = outer.bounds
    return bool((low < inner.bounds[0]).all() and (inner.bounds[1] < high).all())


def _merge(mesh: trimesh.Trimesh) -> None:
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
