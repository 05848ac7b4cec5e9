"""The surface of an object as a camera sees it, for exports: no engine is needed.

The shapes of ``UrdfFile`` come with PyBullet. Only what its single bodies use is read: boxes and
OBJ files, with their size and place.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from grasp_factory.core.geometry import Array, apply, rotation_of_rpy, transform
from grasp_factory.core.limits import MESH
from grasp_factory.core.package_files import folder_of
from grasp_factory.core.triangle_mesh import TriangleMesh, merged
from grasp_factory.objects.base import ObjectModel, Part, UrdfFile
from grasp_factory.objects.obj_file import read_triangles
from grasp_factory.objects.unit_meshes import mesh_file
from grasp_factory.objects.visual import visual_parts


def object_mesh(model: ObjectModel) -> TriangleMesh:
    """Return the visual surface of an object in its own frame, metres, at its own size.

    Raises:
        MissingLibraryError: if its shape comes with PyBullet, which is not installed.
        LimitError: if it has too many triangles.
    """
    if isinstance(model.body, UrdfFile):
        pieces = _urdf_triangles(folder_of("pybullet_data") / model.body.path, model.body.scale)
    else:
        pieces = map(_part_triangles, visual_parts(model.body))
    triangles = np.concatenate(list(pieces))
    MESH.check(len(triangles), model.object_id)
    return merged(triangles, model.color)


def _part_triangles(part: Part) -> Array:
    """Return the triangles (F, 3, 3) of a mesh file in an object."""
    return apply(part.pose.matrix(), read_triangles(Path(part.shape)) * part.size)


def _urdf_triangles(path: Path, scale: float) -> Iterator[Array]:
    """Yield the triangles (F, 3, 3) of each visual shape of a URDF file with one link."""
    for visual in ElementTree.parse(path).getroot().iterfind("link/visual"):
        box, mesh = visual.find("geometry/box"), visual.find("geometry/mesh")
        if box is not None:
            unit, size = read_triangles(Path(mesh_file("box"))), _numbers(box.attrib["size"])
        else:
            assert mesh is not None, path
            unit = read_triangles(path.parent / mesh.attrib["filename"])
            size = _numbers(mesh.get("scale", "1 1 1"))
        yield scale * apply(_origin(visual), unit * size)


def _origin(visual: ElementTree.Element) -> Array:
    """Return the pose (4, 4) of a visual shape in its link's frame, metres."""
    origin = visual.find("origin")
    if origin is None:
        return np.eye(4)
    rotation = rotation_of_rpy(_numbers(origin.get("rpy", "0 0 0")))
    return transform(rotation, _numbers(origin.get("xyz", "0 0 0")))


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])
