"""A surface of triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array, Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class TriangleMesh:
    """A surface of one or several closed shapes, which may overlap."""

    vertices: Array
    """(V, 3) metres."""
    faces: NDArray[np.int64]
    """(F, 3), indices of vertices, counter-clockwise as seen from outside."""
    color: Vector3 | None = None
    """RGB in 0 to 1; None if it is not known."""

    def scaled(self, factor: float) -> TriangleMesh:
        """Return the mesh, larger by a factor."""
        return TriangleMesh(vertices=factor * self.vertices, faces=self.faces, color=self.color)

    @property
    def center(self) -> Array:
        """The centre of the bounding box, (3,) metres."""
        center: Array = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2.0
        return center


def merged(triangles: Array, color: Vector3 | None = None) -> TriangleMesh:
    """Return the mesh of triangles (F, 3, 3), in metres; equal corners become one vertex."""
    vertices, faces = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    return TriangleMesh(vertices=vertices, faces=faces.reshape(-1, 3), color=color)
