"""The source of one object: the data to convert, and the properties stated in its file."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from grasp_factory.core.cache import digest
from grasp_factory.errors import shown
from grasp_factory.objects.importing.base import UnusableError
from grasp_factory.objects.importing.folder_listing import MAX_BYTES, read_inside, suffix
from grasp_factory.objects.importing.messages import Job, Shape
from grasp_factory.objects.importing.references import mesh_file, named_meshes
from grasp_factory.objects.importing.settings import Settings
from grasp_factory.objects.importing.urdf import Urdf, parse_urdf


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSource:
    """All data that is read about an object before it is converted."""

    job: Job
    blobs: tuple[bytes, ...]
    """The meshes' content."""
    sha256: str
    """Digest of the meshes' content; the colour is derived from it if no colour is stated."""
    family: str
    urdf: Urdf | None = None
    scale: float = 1.0
    """Scale of the URDF."""
    files: tuple[str, ...] = ()
    """The meshes of a URDF that were read, as paths in the folder."""
    warnings: tuple[str, ...] = ()


def load_source(root: Path, file: str, own: Settings, defaults: Settings) -> ObjectSource:
    """Read an object's file, and the meshes that it refers to.

    Raises:
        UnusableError: if one of them cannot be read, or the URDF is invalid.
    """
    family = PurePosixPath(file).parent.name or "mesh"
    data = read_inside(root, file)
    if suffix(file) == "urdf":
        return _of_urdf(root, file, data, own.scale or 1.0, family)
    scale = own.scale or defaults.scale
    size = (scale or 1.0,) * 3
    shape = Shape(kind=suffix(file), size=size, blob=0)
    job = Job(collision=(shape,), guess_units=scale is None)
    return ObjectSource(job=job, blobs=(data,), sha256=digest(data), family=family)


def referenced(root: Path, file: str) -> set[str]:
    """Return the files of the folder that a URDF names as meshes, even if the URDF is refused."""
    try:
        names = named_meshes(read_inside(root, file))
    except UnusableError:
        return set()
    found = set[str]()
    for name in names:
        with contextlib.suppress(UnusableError):
            found.add(_mesh_path(root, name, file))
    return found


def _of_urdf(root: Path, file: str, data: bytes, scale: float, family: str) -> ObjectSource:
    urdf = parse_urdf(data)
    meshes = _Meshes(root, file, urdf.files)
    warnings = urdf.warnings
    collision = meshes.read(urdf.collision)
    visual: tuple[Shape, ...] = ()
    needed = list(meshes.blobs.values())
    try:
        visual = meshes.read(urdf.visual)
    except UnusableError as error:
        warnings += (f"seen as it collides, for {error}",)
    job = Job(
        collision=tuple(_scaled(shape, scale) for shape in collision),
        visual=tuple(_scaled(shape, scale) for shape in visual),
    )
    hashes = sorted({digest(blob) for blob in needed})
    sha256 = hashes[0] if len(hashes) == 1 else digest("".join(hashes).encode() or data)
    return ObjectSource(
        job=job,
        blobs=tuple(meshes.blobs.values()),
        sha256=sha256,
        family=family,
        urdf=urdf,
        scale=scale,
        files=tuple(meshes.blobs),
        warnings=warnings,
    )


class _Meshes:
    """The mesh files of a URDF; each is read once, even if it has several names."""

    def __init__(self, root: Path, urdf: str, names: Sequence[str]) -> None:
        self._root = root
        self._urdf = urdf
        self._names = names
        self.blobs: dict[str, bytes] = {}

    def read(self, shapes: Sequence[Shape]) -> tuple[Shape, ...]:
        """Read the meshes of shapes, all or none, and return the shapes with their indices."""
        before = dict(self.blobs)
        try:
            paths = {i: self._path(self._names[i]) for i in _used(shapes)}
        except UnusableError:
            self.blobs = before
            raise
        places = {path: place for place, path in enumerate(self.blobs)}
        return tuple(
            dataclasses.replace(shape, blob=places[paths[shape.blob]]) if shape.blob >= 0 else shape
            for shape in shapes
        )

    def _path(self, name: str) -> str:
        """Return the path of a mesh, and read the mesh if that is not done yet."""
        path = _mesh_path(self._root, name, self._urdf)
        if path not in self.blobs:
            try:
                self.blobs[path] = read_inside(self._root, path)
            except UnusableError as error:
                raise UnusableError(f"its mesh {shown(name)}: {error}") from None
            if sum(map(len, self.blobs.values())) > MAX_BYTES:
                raise UnusableError(f"its meshes have more than {MAX_BYTES // 2**20} MiB together")
        return path


def _mesh_path(root: Path, name: str, urdf: str) -> str:
    for option in mesh_file(name, urdf):
        if os.path.lexists(root / option):
            return option
    raise UnusableError(f"its mesh {shown(name)} is not in the folder")


def _used(shapes: Iterable[Shape]) -> list[int]:
    return sorted({shape.blob for shape in shapes if shape.blob >= 0})


def _scaled(shape: Shape, scale: float) -> Shape:
    (a, b, c), (x, y, z) = shape.size, shape.position
    return dataclasses.replace(
        shape,
        size=(a * scale, b * scale, c * scale),
        position=(x * scale, y * scale, z * scale),
    )
