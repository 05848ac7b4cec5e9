"""The visual mesh of an object, from visual or collision shapes. Runs in the child process."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import trimesh

from grasp_factory.core.geometry import Array, Vector3
from grasp_factory.objects.base import PRIMITIVES, Part
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.mesh_reader import MeshSurface
from grasp_factory.objects.importing.messages import Job
from grasp_factory.objects.importing.shapes import part_of, placed, tessellated

MAX_MISFIT = 0.5
"""Share of the collision shapes' largest side by which a visual may extend beyond them."""


def visual_of(
    job: Job,
    read: Callable[[str, int], MeshSurface],
    lower: Array,
    upper: Array,
    warnings: list[str],
) -> tuple[trimesh.Trimesh | None, Vector3 | None]:
    """Return the visual shapes as a mesh, and its own colour; None if there are no usable ones.

    Args:
        job: with shapes in metres.
        read: function that returns a file's surface by its kind and its index in the job.
        lower: corner of the bounding box of the collision shapes, (3,) metres.
        upper: the opposite corner.
        warnings: list; the reason is added to it if the visual shapes are not used.
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
    """Return what collides as a mesh; None if all are primitives, which are rendered directly."""
    if not meshes:
        return None
    return trimesh.util.concatenate(
        [_both_sides(mesh) for mesh in meshes] + [tessellated(part) for part in parts]
    )


def _check_fit(found: Array, lower: Array, upper: Array) -> None:
    """Refuse a visual of another size or place: cameras would see it where nothing collides."""
    size = float((upper - lower).max())
    beyond = float(max((lower - found[0]).max(), (found[1] - upper).max()))
    own = float(np.ptp(found, axis=0).max())
    if beyond > MAX_MISFIT * size or own < MAX_MISFIT * size:
        raise UnusableError(
            f"it is {own * 1e3:.4g} mm long and lies up to {max(0.0, beyond) * 1e3:.4g} mm outside"
            f" what collides, which is {size * 1e3:.4g} mm long"
        )


def _both_sides(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh that is also visible from inside if it is open."""
    if mesh.is_watertight:
        return mesh
    inside = mesh.copy()
    inside.invert()
    return trimesh.util.concatenate([mesh, inside])
