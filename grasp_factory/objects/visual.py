"""The appearance of an object: a mesh file for each visual shape.

The renderer's own capsules are coarse and pointed, and its own boxes show no textures.
"""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Pose, apply
from grasp_factory.objects.base import PRIMITIVES, Compound, Part
from grasp_factory.objects.unit_meshes import mesh_file


def visual_parts(body: Compound) -> tuple[Part, ...]:
    """Return the visual parts, all of them mesh files; a capsule becomes three parts."""
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
