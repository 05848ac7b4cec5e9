"""Wavefront OBJ files of polyhedra: written for the simulator, read for the mass properties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from grasp_factory.core.geometry import Array


@dataclass(frozen=True, slots=True)
class Corner:
    """A corner of a face: its position, texture coordinates and normal."""

    position: tuple[float, float, float]
    texture: tuple[float, float]
    normal: tuple[float, float, float]


Face = Sequence[Corner]
"""A flat polygon, counter-clockwise as seen from outside."""
Polyhedron = Sequence[Face]
"""A closed convex polyhedron; it becomes one ``o`` group."""


def obj_text(solids: Sequence[Polyhedron]) -> str:
    """Return the OBJ text of some solids; equal values are written once."""
    tables: dict[str, dict[str, int]] = {"v": {}, "vt": {}, "vn": {}}
    groups = []
    for i, solid in enumerate(solids):
        groups.append(f"o part_{i}")
        for face in solid:
            corners = (
                "/".join(
                    str(tables[kind].setdefault(numbers_text(value), len(tables[kind]) + 1))
                    for kind, value in zip(
                        tables, (corner.position, corner.texture, corner.normal), strict=True
                    )
                )
                for corner in face
            )
            groups.append(f"f {' '.join(corners)}")
    values = [f"{kind} {row}" for kind, table in tables.items() for row in table]
    return "\n".join([*values, *groups, ""])


@cache
def triangles(path: Path) -> Array:
    """Return the triangles of one of the few files that are used again and again."""
    return read_triangles(path)


def read_triangles(path: Path) -> Array:
    """Return the triangles (n, 3, 3) of all groups of a file; each face becomes a triangle fan."""
    vertices: list[list[float]] = []
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        match line.split():
            case ["v", *words]:
                vertices.append([float(word) for word in words[:3]])
            case ["f", *words]:
                first, *others = (int(word.split("/")[0]) - 1 for word in words)
                found += [(first, a, b) for a, b in pairwise(others)]
    corners: Array = np.array(vertices)[np.array(found)]
    return corners


def numbers_text(values: Sequence[float]) -> str:
    """Return numbers as OBJ text: at most 7 decimals and 7 digits, never -0."""
    return " ".join(f"{round(value, 7) + 0.0:.7g}" for value in values)  # + 0.0: no minus zero
