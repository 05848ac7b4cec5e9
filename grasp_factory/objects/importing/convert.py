"""Convert the content of files to an object for the engine. Runs in the child process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from grasp_factory.core.cache import digest
from grasp_factory.core.geometry import Array, Pose, Vector3, transform
from grasp_factory.core.linear import total
from grasp_factory.objects.base import MAX_HULLS, PRIMITIVES, Part
from grasp_factory.objects.folder import MAX_PRIMITIVES, MAX_REACH, Geometry
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.hulls import convex_parts, hull_of
from grasp_factory.objects.importing.mesh_reader import MeshSurface, read_mesh
from grasp_factory.objects.importing.messages import Converted, Job
from grasp_factory.objects.importing.obj_text import collision_text, visual_text
from grasp_factory.objects.importing.shapes import part_of, placed, solid_of, tessellated
from grasp_factory.objects.importing.units import check_size, sides
from grasp_factory.objects.importing.visual_mesh import as_it_collides, visual_of
from grasp_factory.objects.solids import Moments, bounds, moments, polyhedron, principal_axes

DIGITS = 9
"""Significant digits of stored numbers: enough for the single precision of mesh files."""


def convert(job: Job, blobs: Sequence[bytes]) -> tuple[Converted, dict[str, bytes]]:
    """Return the converted object, and its OBJ files by their SHA-256.

    Raises:
        UnusableError: if no object can be made from it.
    """
    if sum(shape.kind in PRIMITIVES for shape in job.collision) > MAX_PRIMITIVES:
        raise UnusableError(f"it has more than {MAX_PRIMITIVES} primitive shapes")
    if sum(shape.kind not in PRIMITIVES for shape in job.collision) > MAX_HULLS:
        raise UnusableError(f"it has more than {MAX_HULLS} meshes that collide")

    @cache
    def read(kind: str, blob: int) -> MeshSurface:
        return read_mesh(kind, blobs[blob])

    warnings: list[str] = []
    solids = [shape for shape in job.collision if shape.kind in PRIMITIVES]
    parts = [part_of(shape) for shape in solids]
    meshes, color = [], None
    for shape in job.collision:
        if shape.kind not in PRIMITIVES:
            surface = read(shape.kind, shape.blob)
            meshes.append(placed(surface, shape, job.guess_units, warnings))
            color = color or surface.color
    lower, upper, measured = _measured(meshes, parts)  # before the slow decomposition
    bodies = [_Body.of(mesh, MAX_HULLS // len(meshes), warnings) for mesh in meshes]
    hulls = [hull for body in bodies for hull in body.hulls]

    volume, pose, squares = _distribution(
        [body.moments for body in bodies] + ([moments(parts)] if parts else [])
    )
    files = {}
    if hulls:
        files["collision"] = collision_text(hulls)
    seen, own_color = visual_of(job, read, lower, upper, warnings)
    if seen is None:
        seen = as_it_collides([body.mesh for body in bodies], parts)
    if seen is not None:
        files["visual"] = visual_text(seen)
    named = {kind: digest(text) for kind, text in files.items()}
    geometry = Geometry(
        lower=_rounded(lower),
        upper=_rounded(upper),
        com=_rounded(np.array(pose.position)),
        axes_xyzw=pose.quat_xyzw,
        gyration_squared=squares,
        solids=tuple(solid_of(shape) for shape in solids),
        hulls=len(hulls),
        **named,
    )
    found = Converted(
        geometry=geometry,
        volume=float(f"{volume:.{DIGITS}g}"),
        sides=measured,
        color=own_color or color,
        warnings=tuple(dict.fromkeys(warnings)),
    )
    return found, {digest(text): text for text in files.values()}


@dataclass(frozen=True, slots=True)
class _Body:
    """A mesh in the object's frame, metres."""

    mesh: trimesh.Trimesh
    hulls: list[ConvexHull]
    moments: Moments

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, room: int, warnings: list[str]) -> _Body:
        hulls, is_closed = convex_parts(mesh, max(1, room), warnings)
        if is_closed:
            own = polyhedron(np.asarray(mesh.triangles))
            if _is_physical(own, hull_of(mesh.vertices)):
                return cls(mesh, hulls, own)
        warnings.append("no closed surface: volume and inertia are those of its convex parts")
        return cls(mesh, hulls, _sum_of(hulls))


def _measured(
    meshes: Sequence[trimesh.Trimesh], parts: Sequence[Part]
) -> tuple[Array, Array, Vector3]:
    """Return the corners of the bounding box, (3,) metres each, and ``ImportedObject.sides``."""
    boxes = [mesh.bounds for mesh in meshes] + [np.array(bounds([part])) for part in parts]
    lower = np.min([low for low, _ in boxes], axis=0)
    upper = np.max([high for _, high in boxes], axis=0)
    if max(np.abs(lower).max(), np.abs(upper).max()) > MAX_REACH:
        raise UnusableError(f"it lies, or reaches, more than {MAX_REACH:g} m from its origin")
    corners = [*(mesh.vertices for mesh in meshes), *(tessellated(p).vertices for p in parts)]
    whole = hull_of(np.vstack(corners))
    measured = sides(whole.points[whole.vertices], _normals(whole))
    check_size(measured)
    return lower, upper, _rounded(np.array(measured))


def _distribution(found: Sequence[Moments]) -> tuple[float, Pose, Vector3]:
    """Return the volume, the centre of mass with the principal axes, and ``gyration_squared``."""
    volume = total(one.volume for one in found)
    com = np.sum([one.first for one in found], axis=0) / volume
    second = np.sum([one.second for one in found], axis=0) / volume - np.outer(com, com)
    R, (x, y, z) = principal_axes(second)
    squares = _rounded(np.array([y + z, z + x, x + y]))
    return volume, Pose.from_matrix(transform(R, com)), squares


def _is_physical(own: Moments, whole: ConvexHull) -> bool:
    """Return whether the moments of a closed surface are possible for a solid within its hull."""
    com = own.first / own.volume
    squares = np.linalg.eigvalsh(own.second / own.volume - np.outer(com, com))
    outside = (whole.equations[:, :3] @ com + whole.equations[:, 3]).max()
    largest = float(np.ptp(whole.points, axis=0).max())
    return bool(outside <= 0.0 and squares[0] > 1e-6 * largest**2)


def _sum_of(hulls: Sequence[ConvexHull]) -> Moments:
    found = [
        polyhedron(np.where(_outwards(hull)[:, None, None], faces, faces[:, ::-1]))
        for hull in hulls
        for faces in [hull.points[hull.simplices]]
    ]
    return Moments(
        total(one.volume for one in found),
        np.sum([one.first for one in found], axis=0),
        np.sum([one.second for one in found], axis=0),
    )


def _outwards(hull: ConvexHull) -> Array:
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) > 0.0)


def _normals(hull: ConvexHull) -> Array:
    _, some = np.unique(np.round(hull.equations[:, :3], 3), axis=0, return_index=True)
    return np.asarray(hull.equations[some, :3])


def _rounded(v: Array) -> Vector3:
    x, y, z = (float(f"{a:.{DIGITS}g}") for a in v)
    return x, y, z
