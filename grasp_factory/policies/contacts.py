"""Pairs of contacts on a surface that two pads can press on without slipping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.elementary import arccos, arctan2, sincos
from grasp_factory.core.geometry import Array
from grasp_factory.core.linear import length, norm
from grasp_factory.policies.surface import Surface

CELL = 0.008
"""Metres, and ``CELL_YAW_DEG`` degrees: of pairs that are closer than this, the best is kept."""
CELL_YAW_DEG = 10.0
CELL_RISE = 0.2
"""As above, for the sine of the closing axis's elevation."""
SHORTEST = 0.004
"""Metres: contacts that lie closer together, seen from above, are one edge seen twice."""
LEVER_SCALE = 0.03
"""Metres that count as much as one radian when pairs are ranked before they are checked."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Closing axes with the middles between their contacts, the most promising first."""

    middles: Array
    """(K, 3) metres, world."""
    axes: Array
    """(K, 3) unit, from the first contact to the second."""


def antipodal_pairs(
    contacts: Surface, *, aim: Array, longest: float, friction: float, steepest: float
) -> Pairs:
    """Return the pairs whose two normals lie within the friction cone about the closing axis.

    Args:
        contacts: Where pads may touch.
        aim: Where closing axes pass at best, (3,) metres.
        longest: Metres that the gripper can span.
        friction: Coulomb coefficient; the cone's half-angle is its arc tangent.
        steepest: Largest elevation of a closing axis, rad. Pads are areas, so contacts at
            different heights can be closed on along a flatter axis.
    """
    P, N = contacts.points, contacts.normals
    i, j = np.triu_indices(len(P), 1)
    way = P[j] - P[i]
    level = norm(way[:, :2])
    near = (level > SHORTEST) & (level < longest)
    i, j, way, level = i[near], j[near], way[near], level[near]
    axes = _flattened(way, level, steepest)
    opposed = np.minimum(-(N[i] * axes).sum(axis=1), (N[j] * axes).sum(axis=1))
    inside = opposed >= 1.0 / length((1.0, friction))
    i, j, axes, opposed = i[inside], j[inside], axes[inside], opposed[inside]
    middles = (P[i] + P[j]) / 2.0
    offsets = aim - middles
    levers = norm(np.cross(offsets, axes))
    rank = arccos(np.minimum(opposed, 1.0)) + levers / LEVER_SCALE
    chosen = _one_of_each(middles, axes, np.argsort(rank, kind="stable"))
    return Pairs(middles[chosen], axes[chosen])


def _flattened(way: Array, level: Array, steepest: float) -> Array:
    """Return unit axes (K, 3) along ways, or at the elevation ``steepest`` where these are steeper.

    Args:
        way: (K, 3), not vertical.
        level: The lengths of their horizontal parts, (K,).
        steepest: Rad.
    """
    sine, cosine = (float(v) for v in sincos(steepest))
    axes = way / norm(way)[:, None]
    steep = np.abs(axes[:, 2]) > sine
    axes[steep, :2] = way[steep, :2] * (cosine / level[steep])[:, None]
    axes[steep, 2] = np.copysign(sine, way[steep, 2])
    return axes


def _one_of_each(middles: Array, axes: Array, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first of each cell of similar pairs, in the given order."""
    yaw = arctan2(axes[:, 1], axes[:, 0]) % math.pi
    cells = np.column_stack(
        [
            np.floor(middles / CELL),
            np.floor(yaw / math.radians(CELL_YAW_DEG)),
            np.round(axes[:, 2] / CELL_RISE),
        ]
    ).astype(np.int64)
    shifted = cells - cells.min(axis=0, initial=0)
    keys = np.ravel_multi_index(tuple(shifted.T), tuple(shifted.max(axis=0, initial=0) + 1))
    _, first = np.unique(keys[order], return_index=True)
    return order[np.sort(first)]
