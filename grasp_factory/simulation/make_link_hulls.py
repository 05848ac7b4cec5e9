"""Make the arm's collision hulls: ``python -m grasp_factory.simulation.make_link_hulls``.

Loading the convex hulls of the iiwa's own meshes (7,500 points) took four fifths of the time of
building a scene, at every episode. The hulls only serve to detect contacts of the arm
while it moves. A millimetre does not matter there: the engine's own collision margin is as wide.
"""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.core.package_files import folder_of
from grasp_factory.simulation.world import DATA

MESHES = DATA / "kuka_iiwa" / "meshes"
HULLS = folder_of("grasp_factory") / "robots" / "assets"
LINKS = tuple(f"link_{i}" for i in range(8))
TOLERANCE = 0.001
"""Metres by which a hull may be smaller than the mesh's hull, in any direction."""
DIRECTIONS = 20_000
"""Number of directions in which the hulls are compared: about 1.4 degrees apart."""

_HEADER = """\
# Points of the convex hull of {name}.stl in pybullet_data/kuka_iiwa (lbr_iiwa model,
# R. Krug and T. Stoyanov, Orebro University, BSD-2-Clause), to 1 mm; see make_link_hulls.py.
"""


def link_hull(points: Array) -> Array:
    """Return a small subset (K, 3) of the points (N, 3), metres, that has nearly the same hull.

    Greedy: it adds the point farthest outside the hull so far until all are within the tolerance.
    """
    along = points @ directions().T
    full, farthest = along.max(axis=0), along.argmax(axis=0)
    chosen: list[int] = []
    reached = np.full(DIRECTIONS, -np.inf)
    while (full - reached).max() > TOLERANCE:
        chosen.append(int(farthest[(full - reached).argmax()]))
        reached = np.maximum(reached, along[chosen[-1]])
    return points[chosen]


def directions() -> Array:
    """Return unit vectors (``DIRECTIONS``, 3), spread evenly: Fibonacci's lattice on a sphere."""
    i = np.arange(DIRECTIONS) + 0.5
    z, angle = 1.0 - 2.0 * i / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def hull_text(name: str) -> str:
    """Return the OBJ file of a link's hull. Needs trimesh, which is in the extra ``meshes``."""
    import trimesh  # noqa: PLC0415

    points = link_hull(np.asarray(trimesh.load(MESHES / f"{name}.stl").vertices, np.float64))
    hull = trimesh.convex.convex_hull(np.round(points, 5))
    text = hull.export(file_type="obj", digits=5, header=None, include_normals=False)
    return f"{_HEADER.format(name=name)}o {name}\n{text.rstrip()}\n"


if __name__ == "__main__":
    for link in LINKS:
        (HULLS / f"{link}.obj").write_text(hull_text(link), encoding="utf-8")
