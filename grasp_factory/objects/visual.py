"""What an object looks like: mesh files for everything that is seen.

The renderer's own capsule is a crude pointed thing, and textures do not map onto its boxes.
"""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Pose, apply
from grasp_factory.objects.base import PRIMITIVES, Compound, Part
from grasp_factory.objects.unit_meshes import mesh_file


def visual_parts(body: Compound) -> tuple[Part, ...]:
    """Return the parts that are seen, all of them mesh files; a capsule is three."""
    return tuple(mesh for part in body.visual or body.parts for mesh in _meshes(part))


def _meshes(part: Part) -> tuple[Part, ...]:
    if part.shape == "capsule":
        return _capsule(part)
    shape = mesh_file(part.shape) if part.shape in PRIMITIVES else part.shape
    return (Part(shape=shape, size=part.size, pose=part.pose),)


def _capsule(part: Part) -> tuple[Part, ...]:
    diameter, _, length = part.size
    tube, ball = (diameter, diameter, length - diameter), (diameter, diameter, diameter)
    centers = apply(part.pose.matrix(), np.array([[0.0, 0.0, -0.5], [0.0, 0.0, 0.5]]) * tube[2])
    ends = (
        Part(shape=mesh_file("sphere"), size=ball, pose=Pose((x, y, z), part.pose.quat_xyzw))
        for x, y, z in centers.tolist()
    )
    return (Part(shape=mesh_file("cylinder"), size=tube, pose=part.pose), *ends)
