"""Convert a job's shapes to meshes and parts in the object's frame. Runs in the child process."""

from __future__ import annotations

import numpy as np
import trimesh

from grasp_factory.core.geometry import Pose, apply
from grasp_factory.objects.base import Part
from grasp_factory.objects.folder import ConvexPart
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.mesh_reader import MeshSurface
from grasp_factory.objects.importing.messages import Shape
from grasp_factory.objects.importing.solid_mesh import tidied
from grasp_factory.objects.importing.units import guess_scale


def placed(surface: MeshSurface, shape: Shape, guess: bool, warnings: list[str]) -> trimesh.Trimesh:
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


def _pose(shape: Shape) -> Pose:
    return Pose(shape.position, shape.quat_xyzw)


def part_of(shape: Shape) -> Part:
    """Return a primitive as a part for the engine."""
    return Part(shape=shape.kind, size=shape.size, pose=_pose(shape))


def solid_of(shape: Shape) -> ConvexPart:
    """Return a primitive as a record of the manifest."""
    return ConvexPart(
        shape=shape.kind, size=shape.size, position=shape.position, quat_xyzw=shape.quat_xyzw
    )


def tessellated(part: Part) -> trimesh.Trimesh:
    """Return a primitive as triangles."""
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
