"""Create parts from their dimensions, in metres, and their rotation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grasp_factory.core.elementary import sincos
from grasp_factory.core.geometry import Pose, QuatXyzw, Vector3
from grasp_factory.objects.base import Part
from grasp_factory.objects.unit_meshes import WEDGES, mesh_file

Parts = tuple[Part, ...]
ORIGIN: Vector3 = (0.0, 0.0, 0.0)
UPRIGHT: QuatXyzw = (0.0, 0.0, 0.0, 1.0)
ALONG_X: QuatXyzw = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
"""The part's z becomes x."""
ALONG_Y: QuatXyzw = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""The part's z becomes y."""
ON_EDGE: QuatXyzw = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""The part's y becomes z, and x stays."""
_SINE, _COSINE = (float(v) for v in sincos(math.pi / WEDGES))
_HALF_SINE, _HALF_COSINE = (float(v) for v in sincos(math.pi / 2 / WEDGES))
FLAT_TO_X: QuatXyzw = (0.0, 0.0, _HALF_SINE, _HALF_COSINE)
"""A flat side of the ring faces +x, so that a handle can touch it."""
FLAT_AT = _COSINE
"""Distance of that side from the axis, in outer radii."""
FLAT_WIDTH = _SINE
"""Width of that side, in outer diameters."""


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number uniformly."""
    return float(rng.uniform(low, high))


def one_of(rng: np.random.Generator, values: Sequence[int]) -> int:
    """Draw one of some numbers."""
    return values[int(rng.integers(len(values)))]


def box(size: Vector3, at: Vector3 = ORIGIN) -> Part:
    """Return a box with these sides."""
    return Part(shape="box", size=size, pose=Pose(at, UPRIGHT))


def cylinder(
    diameter: float, length: float, at: Vector3 = ORIGIN, turn: QuatXyzw = UPRIGHT
) -> Part:
    """Return a cylinder, along z unless it is turned."""
    return Part(shape="cylinder", size=(diameter, diameter, length), pose=Pose(at, turn))


def mesh(name: str, size: Vector3, at: Vector3 = ORIGIN, turn: QuatXyzw = UPRIGHT) -> Part:
    """Return a unit mesh; ``size`` is that of its bounding box before it is turned."""
    return Part(shape=mesh_file(name), size=size, pose=Pose(at, turn))
