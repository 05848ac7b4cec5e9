"""An archive of one object, as a store of a user's own objects contains it."""

from __future__ import annotations

import dataclasses
import io
import zipfile

from grasp_factory.core.cache import digest
from grasp_factory.objects.folder import ConvexPart, FolderObject, Geometry, Manifest

COLLISION = (
    b"o part_0\nv 0 0 0\nv 0.05 0 0\nv 0 0.05 0\nv 0 0 0.05\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
)
VISUAL = b"o seen\nv 0 0 0\nv 0.05 0 0\nv 0 1e-05 -0.05\nvt 0 1\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n"


GEOMETRY = Geometry(
    lower=(0.0, 0.0, 0.0),
    upper=(0.05, 0.05, 0.05),
    com=(0.0125, 0.0125, 0.0125),
    axes_xyzw=(0.0, 0.0, 0.0, 1.0),
    gyration_squared=(1e-4, 1e-4, 1e-4),
    collision=digest(COLLISION),
    visual=digest(VISUAL),
    hulls=1,
)
ITEM = FolderObject(
    family="mesh",
    shape_sha256=digest(b"a source"),
    mass=0.1,
    lateral_friction=0.5,
    color=(0.5, 0.5, 0.5),
    geometry=GEOMETRY,
)


def manifest(collision: bytes = COLLISION) -> bytes:
    """Return the manifest of an object with this mesh and a box."""
    box = ConvexPart(
        shape="box",
        size=(0.01, 0.02, 0.03),
        position=(0.0, 0.0, 0.0),
        quat_xyzw=(0.0, 0.0, 0.0, 1.0),
    )
    geometry = dataclasses.replace(GEOMETRY, collision=digest(collision), solids=(box,))
    return Manifest(objects={"a": dataclasses.replace(ITEM, geometry=geometry)}).encoded()


def archive(collision: bytes = COLLISION, told: bytes = b"") -> bytes:
    """Return an archive of an object with this mesh; ``told`` is its manifest, if it is another."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as file:
        file.writestr("manifest.json", told or manifest(collision))
        for data in (collision, VISUAL):
            file.writestr(f"{digest(data)}.obj", data)
    return buffer.getvalue()
