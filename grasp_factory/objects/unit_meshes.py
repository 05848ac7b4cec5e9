"""The unit meshes in ``assets``: what procedural objects are put together from and look like.

Each has a bounding box of 1 x 1 x 1 centred at the origin and is scaled per axis. They are files,
and few, because the engine never frees a mesh that is given as an array and keeps each new file.
``make_unit_meshes`` writes them.
"""

from __future__ import annotations

from pathlib import Path

ASSETS = Path(__file__).parent / "assets"

ROUND = 32
"""Sides of what is round: at a radius of 40 mm the chords lie up to 0.2 mm inside."""
SPHERE = (48, 24)
"""Meridians and bands of the sphere that is seen: within 0.2 mm at a radius of 40 mm, too."""
ELLIPSOID = (24, 12)
"""The same of the ellipsoid, which collides: contacts cost time in proportion to its vertices."""
WEDGES = 16
"""Convex parts of a ring, and sides of the floor that goes with it."""
FRUSTUM_PERCENTS = (30, 45, 60, 70, 80, 90)
"""Top over bottom radius."""
RING_PERCENTS = (40, 50, 60, 70, 80, 90)
"""Inner over outer radius."""
ARCH_PERCENT = 70
"""Inner over outer radius of half a ring, the handle of a mug."""
PRISM_SIDES = (3, 5, 6, 8)


def mesh_file(name: str) -> str:
    """Return the path of a unit mesh."""
    return str(ASSETS / f"{name}.obj")
