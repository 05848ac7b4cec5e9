"""A plain box as a body."""

from __future__ import annotations

from collections.abc import Sequence

from grasp_factory.objects import Compound, Part


def box(half_extents: Sequence[float]) -> Compound:
    """Return a box of uniform density, centred at its origin; ``half_extents`` are in metres."""
    x, y, z = (2.0 * float(half) for half in half_extents)
    xx, yy, zz = x * x, y * y, z * z
    squares = ((yy + zz) / 12.0, (xx + zz) / 12.0, (xx + yy) / 12.0)
    return Compound(parts=(Part(shape="box", size=(x, y, z)),), gyration_squared=squares)
