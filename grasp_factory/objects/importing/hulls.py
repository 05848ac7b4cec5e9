"""Convex decomposition. Runs in the child process: CoACD is native code and imported here."""

from __future__ import annotations

import itertools

import coacd
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from grasp_factory.core.geometry import Array
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.point_groups import joined
from grasp_factory.objects.importing.solid_mesh import (
    MAX_BODIES,
    bends,
    closed_bodies,
    face_parts,
    without_dust,
)

MAX_CORNERS = 64
"""Corners of a hull: contact time depends on them too; twice as many if points would be ``TOO_FAR``
outside."""
TOO_FAR = (1.8e-3, 0.025)
"""Distance in metres, or as a share of the narrowest side, whichever is larger. Scaling the hull
makes up for about half of it."""
CONVEX = 0.98
"""A solid that fills at least this share of its hull is replaced by its hull."""
CORNER_TOLERANCE = 2e-4
"""Metres by which a hull with fewer corners may lie within the original hull."""
MIN_SHARE = 1e-6
"""Hulls with less than this share of the volume of the whole hull are removed."""
SEED = 1
THRESHOLD = 0.08
"""Concavity of a part, for a mesh 2 units long: the library's 0.05 takes twice the time."""
COARSE = 0.2
"""The same for a crumpled mesh, for which ``THRESHOLD`` would take minutes."""
MAX_BENDS = 100.0
"""Above it a mesh is crumpled: a ball has 13, a bowl 10, its rough scan 70, an egg carton 200."""
COACD = {
    "preprocess_resolution": 20,  # voxels for open meshes: walls become a tenth of the size
    "resolution": 500,
    # With the library's 150, 20 and 3 a bowl takes a minute, and its hulls are not tighter.
    "mcts_iterations": 10,
    "mcts_nodes": 10,
    "mcts_max_depth": 2,
}
_DIRECTIONS = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], np.float64)


def convex_parts(
    mesh: trimesh.Trimesh, room: int, warnings: list[str]
) -> tuple[list[ConvexHull], bool]:
    """Return convex solids that approximate a mesh, and whether the mesh encloses a volume.

    Args:
        mesh: in metres; its closed pieces are turned outwards.
        room: largest number of solids.
        warnings: list; differences between collision and visual shape are added to it.

    Raises:
        UnusableError: if the mesh is flat, or falls into too many pieces.
    """
    whole = hull_of(mesh.vertices)
    bodies = closed_bodies(mesh)
    hulls = [reduced(points) for points in _corners(mesh, bodies, room, warnings)]
    valid = [hull for hull in hulls if hull and hull.volume > MIN_SHARE * whole.volume]
    if not valid:
        raise UnusableError("the convex decomposition left nothing of it")
    closed = mesh.is_watertight and mesh.is_winding_consistent
    return valid, closed and MIN_SHARE < mesh.volume / whole.volume <= 1.001


def _corners(
    mesh: trimesh.Trimesh, bodies: list[trimesh.Trimesh], room: int, warnings: list[str]
) -> list[Array]:
    """Return the corners of up to ``room`` convex parts."""
    hulls = [_hull_volume(body) for body in bodies]
    if 0 < len(bodies) <= room and all(hulls):
        found = _of_bodies(bodies, hulls, room, warnings)
    else:
        large = without_dust(mesh)
        labels = face_parts(large)
        if int(labels.max()) >= MAX_BODIES:
            warnings.append("it falls into many pieces, and collides as convex hulls of these")
            return _of_pieces(large, labels, room)
        found = _decomposed(large, room, warnings)
    return joined(found, room) if len(found) > room else found


def _of_bodies(
    bodies: list[trimesh.Trimesh], hulls: list[float], room: int, warnings: list[str]
) -> list[Array]:
    """Return the corners of the convex parts of closed bodies, whose hulls have some volume."""
    hollow = [body.volume < CONVEX * hull for body, hull in zip(bodies, hulls, strict=True)]
    each = (room - hollow.count(False)) // max(1, hollow.count(True))
    found: list[Array] = []
    for body, is_hollow in zip(bodies, hollow, strict=True):
        found += _decomposed(body, each, warnings) if is_hollow else [np.asarray(body.vertices)]
    return found


def _hull_volume(body: trimesh.Trimesh) -> float:
    try:
        return float(hull_of(body.vertices).volume)
    except UnusableError:
        return 0.0


def _of_pieces(mesh: trimesh.Trimesh, labels: NDArray[np.int64], room: int) -> list[Array]:
    """Return the corners of pieces, joined until no group is flat."""
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order])) + 1
    pieces = [mesh.triangles[faces].reshape(-1, 3) for faces in np.split(order, starts)]
    found = joined(pieces, room)
    while len(found) > 1 and any(reduced(points) is None for points in found):
        found = joined(found, len(found) // 2)
    return found


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

    It starts with the outermost points and adds the point farthest outside, as long as that is
    more than ``CORNER_TOLERANCE`` away. The result is scaled to the volume of the full hull, but
    grows at most by the distance that remains: otherwise a long rod would get longer.
    """
    try:
        whole = ConvexHull(points)
        points = points[whole.vertices]
        too_far = max(TOO_FAR[0], TOO_FAR[1] * float(np.ptp(points, axis=0).min()))
        chosen = list(dict.fromkeys(np.argmax(points @ _DIRECTIONS.T, axis=0).tolist()))
        while True:
            hull = ConvexHull(points[chosen])
            outside = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
            outside[chosen] = 0.0
            farthest = int(np.argmax(outside))
            room = MAX_CORNERS * (2 if outside[farthest] > too_far else 1)
            if outside[farthest] < CORNER_TOLERANCE or len(chosen) >= room:
                center = points[chosen].mean(axis=0)
                reach = float(np.linalg.norm(points - center, axis=1).max())
                most = 1.0 + max(0.0, float(outside[farthest])) / reach
                factor = min(most, (whole.volume / hull.volume) ** (1.0 / 3.0))
                return ConvexHull((points[chosen] - center) * factor + center)
            chosen.append(farthest)
    except (QhullError, ValueError):
        return None


def _decomposed(mesh: trimesh.Trimesh, room: int, warnings: list[str]) -> list[Array]:
    if room == 1:
        return [np.asarray(mesh.vertices)]
    center, size = mesh.bounds.mean(axis=0), float(mesh.extents.max())
    points = (mesh.vertices - center) / size
    crumpled = bends(mesh) > MAX_BENDS
    if crumpled:
        warnings.append("it is crumpled, and collides more coarsely than it looks")
    found = coacd.run_coacd(
        coacd.Mesh(points, mesh.faces),
        threshold=COARSE if crumpled else THRESHOLD,
        max_convex_hull=room,
        seed=SEED,
        **COACD,
    )
    return [corners * size + center for corners, _ in found]
