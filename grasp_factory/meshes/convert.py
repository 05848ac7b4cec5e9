"""From the content of files to an object that the engine can load. Runs in the child process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from grasp_factory.geometry import Array, Pose, apply, transform
from grasp_factory.meshes.base import UnusableError
from grasp_factory.meshes.hulls import MAX_HULLS, convex_parts, hull_of
from grasp_factory.meshes.job import Converted, Job, Shape
from grasp_factory.meshes.obj_text import collision_text, visual_text
from grasp_factory.meshes.reading import Surface, read_mesh
from grasp_factory.meshes.tidy import tidied
from grasp_factory.meshes.units import check_size, guess_scale, sides
from grasp_factory.objects.base import PRIMITIVES, Part, Vector3
from grasp_factory.objects.folder import MAX_PRIMITIVES, MAX_REACH, Geometry, Solid
from grasp_factory.objects.folder_cache import digest
from grasp_factory.objects.solids import Moments, bounds, moments, polyhedron, principal_axes

DIGITS = 9
"""Significant ones of what is kept: less than what a file's single precision holds is noise."""


def convert(job: Job, blobs: Sequence[bytes]) -> tuple[Converted, dict[str, bytes]]:
    """Return an object, and its OBJ files by their SHA-256.

    Raises:
        UnusableError: if no object can be made of it.
    """
    if sum(shape.kind in PRIMITIVES for shape in job.collision) > MAX_PRIMITIVES:
        raise UnusableError(f"it has more than {MAX_PRIMITIVES} primitive shapes")
    warnings: list[str] = []
    solids = [shape for shape in job.collision if shape.kind in PRIMITIVES]
    parts = [_part(shape) for shape in solids]
    meshes, color = [], None
    for shape in job.collision:
        if shape.kind not in PRIMITIVES:
            surface = read_mesh(shape.kind, blobs[shape.blob])
            meshes.append(_placed(surface, shape, job.guess_units, warnings))
            color = color or surface.color
    lower, upper, measured = _measured(meshes, parts)  # before the decomposition takes its time
    bodies = [_Body.of(mesh, MAX_HULLS // len(meshes), warnings) for mesh in meshes]
    hulls = [hull for body in bodies for hull in body.hulls]

    volume, pose, squares = _distribution(
        [body.moments for body in bodies] + ([moments(parts)] if parts else [])
    )
    files = {}
    if hulls:
        files["collision"] = collision_text(hulls)
    seen = _seen(job, blobs, bodies, parts, warnings)
    if seen is not None:
        files["visual"] = visual_text(seen)
    named = {kind: digest(text) for kind, text in files.items()}
    geometry = Geometry(
        lower=_rounded(lower),
        upper=_rounded(upper),
        com=_rounded(np.array(pose.position)),
        axes_xyzw=pose.quat_xyzw,
        gyration_squared=squares,
        solids=tuple(_solid(shape) for shape in solids),
        hulls=len(hulls),
        **named,
    )
    found = Converted(
        geometry=geometry,
        volume=float(f"{volume:.{DIGITS}g}"),
        sides=measured,
        color=color,
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
        hulls, is_closed = convex_parts(mesh, max(1, room))
        if is_closed:
            own = polyhedron(np.asarray(mesh.triangles))
            if _is_physical(own, hull_of(mesh.vertices)):
                return cls(mesh, hulls, own)
        warnings.append("no closed surface: volume and inertia are those of its convex parts")
        return cls(mesh, hulls, _sum_of(hulls))


def _measured(
    meshes: Sequence[trimesh.Trimesh], parts: Sequence[Part]
) -> tuple[Array, Array, Vector3]:
    """Return the corners of the bounding box, (3,) metres each, and the object's own sides."""
    boxes = [mesh.bounds for mesh in meshes] + [np.array(bounds([part])) for part in parts]
    lower = np.min([low for low, _ in boxes], axis=0)
    upper = np.max([high for _, high in boxes], axis=0)
    if max(np.abs(lower).max(), np.abs(upper).max()) > MAX_REACH:
        raise UnusableError(f"it lies, or reaches, more than {MAX_REACH:g} m from its origin")
    corners = [*(mesh.vertices for mesh in meshes), *(_tessellated(p).vertices for p in parts)]
    whole = hull_of(np.vstack(corners))
    measured = sides(whole.points[whole.vertices], _normals(whole))
    check_size(measured)
    return lower, upper, _rounded(np.array(measured))


def _distribution(found: Sequence[Moments]) -> tuple[float, Pose, Vector3]:
    """Return the volume, the centre of mass with the principal axes, and ``gyration_squared``."""
    volume = sum(one.volume for one in found)
    com = np.sum([one.first for one in found], axis=0) / volume
    second = np.sum([one.second for one in found], axis=0) / volume - np.outer(com, com)
    R, (x, y, z) = principal_axes(second)
    squares = _rounded(np.array([y + z, z + x, x + y]))
    return volume, Pose.from_matrix(transform(R, com)), squares


def _placed(surface: Surface, shape: Shape, guess: bool, warnings: list[str]) -> trimesh.Trimesh:
    """Return a file's triangles, tidied, in the object's frame, metres."""
    vertices, faces = surface.vertices, surface.faces
    if guess:
        scale, warning = guess_scale(float(np.ptp(vertices, axis=0).max()))
        warnings += [warning] if warning else []
        vertices = vertices * scale
    vertices = apply(_pose(shape).matrix(), vertices * np.array(shape.size))
    if np.prod(np.sign(shape.size)) < 0.0:  # a mirror turns faces inwards
        faces = faces[:, ::-1]
    if np.ptp(vertices, axis=0).max() > 1e3:
        raise UnusableError("it is more than 1 km long; give its scale in objects.yaml")
    mesh, mended = tidied(vertices, faces)
    warnings += ["it had small holes, which were closed"] if mended else []
    return mesh


def _seen(
    job: Job,
    blobs: Sequence[bytes],
    bodies: Sequence[_Body],
    parts: Sequence[Part],
    warnings: list[str],
) -> trimesh.Trimesh | None:
    """Return what is seen; None where the primitives that collide are."""
    try:
        if job.visual:
            meshes = [
                _tessellated(_part(shape))
                if shape.kind in PRIMITIVES
                else _placed(read_mesh(shape.kind, blobs[shape.blob]), shape, False, [])
                for shape in job.visual
            ]
            return trimesh.util.concatenate(meshes)
    except UnusableError as error:
        warnings.append(f"seen as it collides, for its visual mesh cannot be used: {error}")
    if not bodies:
        return None
    return trimesh.util.concatenate(
        [_both_sides(body.mesh) for body in bodies] + [_tessellated(part) for part in parts]
    )


def _both_sides(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh that can be seen from inside, too, where it is open."""
    if mesh.is_watertight:
        return mesh
    inside = mesh.copy()
    inside.invert()
    return trimesh.util.concatenate([mesh, inside])


def _is_physical(own: Moments, whole: ConvexHull) -> bool:
    """Say whether a closed surface has the moments of a solid within its hull."""
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
        sum(one.volume for one in found),
        np.sum([one.first for one in found], axis=0),
        np.sum([one.second for one in found], axis=0),
    )


def _outwards(hull: ConvexHull) -> Array:
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    return np.asarray(np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) > 0.0)


def _normals(hull: ConvexHull) -> Array:
    _, some = np.unique(np.round(hull.equations[:, :3], 3), axis=0, return_index=True)
    return np.asarray(hull.equations[some, :3])


def _pose(shape: Shape) -> Pose:
    return Pose(shape.position, shape.quat_xyzw)


def _part(shape: Shape) -> Part:
    return Part(shape=shape.kind, size=shape.size, pose=_pose(shape))


def _solid(shape: Shape) -> Solid:
    return Solid(
        shape=shape.kind, size=shape.size, position=shape.position, quat_xyzw=shape.quat_xyzw
    )


def _tessellated(part: Part) -> trimesh.Trimesh:
    width, _, height = part.size
    create = trimesh.creation
    if part.shape == "box":
        mesh = create.box(part.size)
    elif part.shape == "sphere":
        mesh = create.icosphere(3, width / 2.0)
    elif part.shape == "cylinder":
        mesh = create.cylinder(width / 2.0, height, sections=32)
    else:
        mesh = create.capsule(height - width, width / 2.0, count=[16, 32])
    return mesh.apply_transform(part.pose.matrix())


def _rounded(v: Array) -> Vector3:
    x, y, z = (float(f"{a:.{DIGITS}g}") for a in v)
    return x, y, z
