"""What is seen of an object: its visual shapes, or what collides. Runs in the child process."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import trimesh

from grasp_factory.core.geometry import Array, Vector3
from grasp_factory.objects.base import PRIMITIVES, Part
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.job import Job
from grasp_factory.objects.importing.mesh_reader import MeshSurface
from grasp_factory.objects.importing.shapes import part_of, placed, tessellated

MAX_MISFIT = 0.5
"""Of the largest side of what collides: how far a visual may reach beyond that."""


def visual_of(
    job: Job,
    read: Callable[[str, int], MeshSurface],
    lower: Array,
    upper: Array,
    warnings: list[str],
) -> tuple[trimesh.Trimesh | None, Vector3 | None]:
    """Return the visual shapes as a mesh, and its own colour; None where there are none to use.

    Args:
        job: with shapes in metres.
        read: returns the surface of a kind of file that the job has at a place.
        lower: corner of the bounding box of what collides, (3,) metres.
        upper: the opposite corner.
        warnings: grows by the reason where the visual shapes are left aside.
    """
    meshes, color = [], None
    try:
        for shape in job.visual:
            if shape.kind in PRIMITIVES:
                meshes.append(tessellated(part_of(shape)))
            else:
                surface = read(shape.kind, shape.blob)
                meshes.append(placed(surface, shape, False, []))
                color = color or surface.color
        if not meshes:
            return None, None
        whole = trimesh.util.concatenate(meshes)
        _check_fit(whole.bounds, lower, upper)
    except UnusableError as error:
        warnings.append(f"seen as it collides, for its visual mesh cannot be used: {error}")
        return None, None
    return whole, color


def as_it_collides(
    meshes: Sequence[trimesh.Trimesh], parts: Sequence[Part]
) -> trimesh.Trimesh | None:
    """Return what collides as a mesh; None where primitives do, which are seen as they are."""
    if not meshes:
        return None
    return trimesh.util.concatenate(
        [_both_sides(mesh) for mesh in meshes] + [tessellated(part) for part in parts]
    )


def _check_fit(found: Array, lower: Array, upper: Array) -> None:
    """Refuse a visual of another size or place: cameras would see what nobody can grasp."""
    size = float((upper - lower).max())
    beyond = float(max((lower - found[0]).max(), (found[1] - upper).max()))
    own = float(np.ptp(found, axis=0).max())
    if beyond > MAX_MISFIT * size or own < MAX_MISFIT * size:
        raise UnusableError(
            f"it is {own * 1e3:.4g} mm long and lies up to {max(0.0, beyond) * 1e3:.4g} mm outside"
            f" what collides, which is {size * 1e3:.4g} mm long"
        )


def _both_sides(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh that can be seen from inside, too, where it is open."""
    if mesh.is_watertight:
        return mesh
    inside = mesh.copy()
    inside.invert()
    return trimesh.util.concatenate([mesh, inside])
