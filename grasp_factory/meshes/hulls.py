"""Convex decomposition. Runs in the child process: CoACD is native code and imported here."""

from __future__ import annotations

import itertools

import coacd
import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from grasp_factory.geometry import Array
from grasp_factory.meshes.base import UnusableError
from grasp_factory.meshes.tidy import closed_bodies

MAX_HULLS = 64
"""Of an object: contacts cost time in proportion."""
MAX_CORNERS = 64
"""Of a hull, for the same reason."""
CONVEX = 0.98
"""A solid that fills so much of its hull is its hull."""
CORNER_TOLERANCE = 2e-4
"""Metres by which a hull may lie within the one that it stands for, once it has few corners."""
MIN_SHARE = 1e-6
"""Hulls of less than this share of the whole's hull are splinters."""
SEED = 1
COACD = {
    "threshold": 0.08,  # concavity, of a mesh of two units: the library's 0.05 takes twice the time
    "preprocess_resolution": 20,  # voxels of what is not closed: walls of a tenth of the size
    "resolution": 500,
    # With the library's 150, 20 and 3 a bowl takes a minute, for hulls that are as tight.
    "mcts_iterations": 10,
    "mcts_nodes": 10,
    "mcts_max_depth": 2,
}
_DIRECTIONS = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], np.float64)


def convex_parts(mesh: trimesh.Trimesh, room: int) -> tuple[list[ConvexHull], bool]:
    """Return convex solids that together stand for a mesh, and whether it encloses a volume.

    Args:
        mesh: in metres.
        room: how many there may be, about: a body has one at least.

    Raises:
        UnusableError: if the mesh is flat.
    """
    whole = hull_of(mesh.vertices)
    bodies = closed_bodies(mesh)
    each = max(1, room // max(1, len(bodies)))
    points = [part for body in bodies for part in _parts_of_closed(body, each)]
    hulls = [reduced(p) for p in points or _decomposed(mesh, room)]
    hulls = [hull for hull in hulls if hull and hull.volume > MIN_SHARE * whole.volume]
    if not hulls:
        raise UnusableError("the convex decomposition left nothing of it")
    closed = mesh.is_watertight and mesh.is_winding_consistent
    return hulls, closed and 0.0 < mesh.volume <= 1.001 * whole.volume


def hull_of(points: Array) -> ConvexHull:
    """Return the convex hull of some points (n, 3).

    Raises:
        UnusableError: if they are flat.
    """
    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        raise UnusableError("it is flat: it encloses no volume") from None


def reduced(points: Array) -> ConvexHull | None:
    """Return a hull of up to ``MAX_CORNERS`` of the points (n, 3); None if they are flat.

    Starting from the outermost points it takes the one that lies farthest outside, as long as
    that is more than ``CORNER_TOLERANCE``. The result has the volume of the whole.
    """
    try:
        whole = ConvexHull(points)
        points = points[whole.vertices]
        chosen = list(dict.fromkeys(np.argmax(points @ _DIRECTIONS.T, axis=0).tolist()))
        while True:
            hull = ConvexHull(points[chosen])
            outside = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
            outside[chosen] = 0.0
            farthest = int(np.argmax(outside))
            if outside[farthest] < CORNER_TOLERANCE or len(chosen) == MAX_CORNERS:
                center = points[chosen].mean(axis=0)
                factor = (whole.volume / hull.volume) ** (1.0 / 3.0)
                return ConvexHull((points[chosen] - center) * factor + center)
            chosen.append(farthest)
    except (QhullError, ValueError):
        return None


def _parts_of_closed(body: trimesh.Trimesh, room: int) -> list[Array]:
    """Return the corners of the convex parts of one closed body."""
    if body.volume >= CONVEX * hull_of(body.vertices).volume:
        return [np.asarray(body.vertices)]
    return _decomposed(body, room)


def _decomposed(mesh: trimesh.Trimesh, room: int) -> list[Array]:
    center, size = mesh.bounds.mean(axis=0), float(mesh.extents.max())
    points = (mesh.vertices - center) / size
    found = coacd.run_coacd(
        coacd.Mesh(points, mesh.faces), max_convex_hull=room, seed=SEED, **COACD
    )
    return [corners * size + center for corners, _ in found]
