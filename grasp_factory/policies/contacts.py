"""Antipodal pairs: two contacts on a surface on which pads can press without slipping."""

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
"""Size of a cell of similar pairs, metres; only the best pair of each cell is kept."""
CELL_YAW_DEG = 10.0
"""The same for the yaw of the closing axis, degrees."""
CELL_RISE = 0.2
"""The same for the sine of the closing axis's elevation."""
SHORTEST = 0.004
"""Smallest horizontal distance of two contacts, metres; closer ones are the same edge."""
LEVER_SCALE = 0.03
"""Distance, in metres, that counts as much as one radian in the ranking of pairs."""


@dataclass(frozen=True, slots=True)
class Pairs:
    """Closing axes and the midpoints between their contacts, the most promising pair first."""

    middles: Array
    """(K, 3) metres, world."""
    axes: Array
    """(K, 3) unit, from the first contact to the second."""


def antipodal_pairs(
    contacts: Surface, *, aim: Array, longest: float, friction: float, steepest: float
) -> Pairs:
    """Return the pairs whose two normals are within the friction cone about the closing axis.

    Args:
        contacts: Points and normals where pads may touch.
        aim: Point through which closing axes should pass, (3,) metres.
        longest: Largest horizontal distance of two contacts, metres.
        friction: Coulomb coefficient; the cone's half-angle is its arc tangent.
        steepest: Largest elevation of a closing axis, rad. Pads are areas, so the gripper can
            close on contacts at different heights along an axis that is less steep.
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
    """Return unit axes (K, 3) along ``way``, with the elevation limited to ``steepest``.

    Args:
        way: Vectors from the first to the second contact, (K, 3), not vertical.
        level: The lengths of their horizontal parts, (K,).
        steepest: Largest elevation, rad.
    """
    sine, cosine = (float(v) for v in sincos(steepest))
    axes = way / norm(way)[:, None]
    steep = np.abs(axes[:, 2]) > sine
    axes[steep, :2] = way[steep, :2] * (cosine / level[steep])[:, None]
    axes[steep, 2] = np.copysign(sine, way[steep, 2])
    return axes


def _one_of_each(middles: Array, axes: Array, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the indices of the first pair of each cell, in the given order."""
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
