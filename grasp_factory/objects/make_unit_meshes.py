"""Make the unit meshes: ``python -m grasp_factory.objects.make_unit_meshes``."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.objects.obj_file import Corner, Face, Polyhedron, obj_text
from grasp_factory.objects.unit_meshes import (
    ARCH_PERCENT,
    ASSETS,
    ELLIPSOID,
    FRUSTUM_PERCENTS,
    PRISM_SIDES,
    RING_PERCENTS,
    ROUND,
    SPHERE,
    WEDGES,
    mesh_file,
)

Span = tuple[float, float]
"""Start and end of an interval of a texture's width, 0 to 1."""


def unit_meshes() -> dict[str, str]:
    """Return the text of every OBJ file by the name of its mesh."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    triangle = square[[0, 1, 3]]
    circle = _polygon(ROUND)
    around = _spans(ROUND)
    meshes = {
        "box": [_loft(square, square)],
        "wedge": [_loft(triangle, triangle)],
        "floor": [_loft(_polygon(WEDGES), _polygon(WEDGES), _spans(WEDGES))],
        "cylinder": [_loft(circle, circle, around)],
        "sphere": [_ball(*SPHERE)],
        "ellipsoid": [_ball(*ELLIPSOID)],
        f"arch_{ARCH_PERCENT}": _arch(ARCH_PERCENT / 100.0),
    }
    for percent in FRUSTUM_PERCENTS:
        meshes[f"frustum_{percent}"] = [_loft(circle, circle * percent / 100.0, around)]
    for percent in RING_PERCENTS:
        meshes[f"ring_{percent}"] = _ring(percent / 100.0)
    for sides in PRISM_SIDES:
        outline = _polygon(sides)
        lower, upper = outline.min(axis=0), outline.max(axis=0)
        outline = (outline - (lower + upper) / 2.0) / (upper - lower)
        meshes[f"prism_{sides}"] = [_loft(outline, outline)]
    return {name: obj_text(solids) for name, solids in meshes.items()}


def _polygon(sides: int) -> Array:
    """Return a regular polygon of diameter 1, (sides, 2), with a corner at +x."""
    angles = 2.0 * np.pi * np.arange(sides) / sides
    return 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])


def _spans(sides: int) -> list[Span]:
    """Return the texture interval of each side if a texture goes around once."""
    return [(i / sides, (i + 1) / sides) for i in range(sides)]


def _loft(bottom: Array, top: Array, spans: Sequence[Span] | None = None) -> Polyhedron:
    """Return the solid between two outlines (n, 2), counter-clockwise, at z of -0.5 and 0.5.

    Args:
        bottom: the outline at z = -0.5.
        top: the outline at z = 0.5; its edges are parallel to those of ``bottom``.
        spans: the texture interval of each side, which is then shaded as round; None for flat
            sides, each with the whole texture.
    """
    n = len(bottom)
    low = np.column_stack([bottom, np.full(n, -0.5)])
    high = np.column_stack([top, np.full(n, 0.5)])
    faces = [_cap(low[::-1], -1.0), _cap(high, 1.0)]
    for i in range(n):
        j = (i + 1) % n
        points = [low[i], low[j], high[j], high[i]]
        flat = np.cross(points[1] - points[0], points[3] - points[0])
        flat /= np.linalg.norm(flat)
        normals = [flat if spans is None else _rounded(flat, point) for point in points]
        u0, u1 = (0.0, 1.0) if spans is None else spans[i]
        textures = ((u0, 0.0), (u1, 0.0), (u1, 1.0), (u0, 1.0))
        faces.append([_corner(*row) for row in zip(points, textures, normals, strict=True)])
    return faces


def _cap(points: Array, z: float) -> Face:
    """Return a face whose normal is along z, with the texture spread over the unit square."""
    return [_corner(p, (p[0] + 0.5, p[1] + 0.5), np.array([0.0, 0.0, z])) for p in points]


def _rounded(flat: Array, point: Array) -> Array:
    """Return the normal at a point of the round surface that a flat side approximates.

    Sides across the round surface, such as those between the wedges of a ring, stay flat.
    """
    radial = point[:2] / np.linalg.norm(point[:2])
    along = float(flat[:2] @ radial)
    if abs(along) < 0.5:
        return flat
    return np.array([*(np.sign(along) * np.hypot(*flat[:2]) * radial), flat[2]])


def _ring(ratio: float) -> list[Polyhedron]:
    """Return a ring as convex wedges."""
    outer = _polygon(WEDGES)
    wedges = []
    for a, b, span in zip(outer, np.roll(outer, -1, axis=0), _spans(WEDGES), strict=True):
        outline = np.array([ratio * a, a, b, ratio * b])
        wedges.append(_loft(outline, outline, [span] * 4))
    return wedges


def _arch(ratio: float) -> list[Polyhedron]:
    """Return the half of a ring at positive x, stretched to the unit box."""
    wedges = _ring(ratio)
    quarter = WEDGES // 4
    return [
        [[_stretched(corner) for corner in face] for face in wedge]
        for wedge in (*wedges[-quarter:], *wedges[:quarter])
    ]


def _stretched(corner: Corner) -> Corner:
    x, y, z = corner.position
    return dataclasses.replace(corner, position=(2.0 * x - 0.5, y, z))


def _ball(meridians: int, bands: int) -> Polyhedron:
    """Return a sphere; its texture is a map of longitude and latitude."""
    faces: list[Face] = []
    for i in range(bands):
        south, north = i / bands, (i + 1) / bands
        for j in range(meridians):
            west, east = j / meridians, (j + 1) / meridians
            corners = [_on_ball(west, south), _on_ball(east, south),
                       _on_ball(east, north), _on_ball(west, north)]  # fmt: skip
            if i == 0:
                del corners[1]
            elif i == bands - 1:
                del corners[2]
            faces.append(corners)
    return faces


def _on_ball(u: float, v: float) -> Corner:
    """Return the corner at longitude ``u`` and latitude ``v``, each as a share of its range."""
    longitude, polar = 2.0 * np.pi * u, np.pi * v
    sine = np.sin(polar)
    normal = np.array([sine * np.cos(longitude), sine * np.sin(longitude), -np.cos(polar)])
    return _corner(0.5 * normal, (u, v), normal)


def _corner(position: Array, texture: tuple[float, float], normal: Array) -> Corner:
    x, y, z = (float(a) for a in position)
    nx, ny, nz = (float(a) for a in normal)
    return Corner((x, y, z), (float(texture[0]), float(texture[1])), (nx, ny, nz))


def write_unit_meshes() -> None:
    """Write every file again."""
    ASSETS.mkdir(exist_ok=True)
    for name, text in unit_meshes().items():
        Path(mesh_file(name)).write_text(text, encoding="ascii")


if __name__ == "__main__":
    write_unit_meshes()
