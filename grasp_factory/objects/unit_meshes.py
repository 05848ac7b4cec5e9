"""The unit meshes in ``assets``: the shapes of procedural objects.

Each has a bounding box of 1 x 1 x 1 centred at the origin and is scaled per axis. They are files,
and few, because the engine never frees a mesh passed as an array, and keeps each new file.
``make_unit_meshes`` writes them.
"""

from __future__ import annotations

from pathlib import Path

ASSETS = Path(__file__).parent / "assets"

ROUND = 32
"""Sides of round shapes: at a radius of 40 mm the chords are up to 0.2 mm inside the circle."""
SPHERE = (48, 24)
"""Meridians and bands of the visual sphere: also within 0.2 mm at a radius of 40 mm."""
ELLIPSOID = (24, 12)
"""The same for the ellipsoid, which collides: contact time is proportional to its vertices."""
WEDGES = 16
"""Convex parts of a ring, and sides of the floor that fits it."""
FRUSTUM_PERCENTS = (30, 45, 60, 70, 80, 90)
"""Top radius over bottom radius, per cent."""
RING_PERCENTS = (40, 50, 60, 70, 80, 90)
"""Inner radius over outer radius, per cent."""
ARCH_PERCENT = 70
"""Inner radius over outer radius, per cent, of half a ring, the handle of a mug."""
PRISM_SIDES = (3, 5, 6, 8)


def mesh_file(name: str) -> str:
    """Return the path of a unit mesh."""
    return str(ASSETS / f"{name}.obj")
