"""One object as the folder has it: what is converted, and what its own file says about it."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from grasp_factory.errors import shown
from grasp_factory.meshes.base import UnusableError
from grasp_factory.meshes.job import Job, Shape
from grasp_factory.meshes.listing import read_inside, suffix
from grasp_factory.meshes.settings import Settings
from grasp_factory.meshes.urdf import Urdf, mesh_file, parse_urdf
from grasp_factory.objects.folder_cache import digest


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Everything that is read of an object before it is converted."""

    job: Job
    blobs: tuple[bytes, ...]
    """The meshes' content."""
    sha256: str
    """Of the meshes' content, so that a mesh and the URDF around it are one object in splits."""
    family: str
    urdf: Urdf | None = None
    scale: float = 1.0
    """Of the URDF."""
    warnings: tuple[str, ...] = ()


def load_source(root: Path, file: str, own: Settings, defaults: Settings) -> Source:
    """Read an object's file, and the meshes that it refers to.

    Raises:
        UnusableError: if one of them cannot be read, or is no URDF.
    """
    family = PurePosixPath(file).parent.name or "mesh"
    data = read_inside(root, file)
    if suffix(file) == "urdf":
        return _of_urdf(root, file, data, own.scale or 1.0, family)
    scale = own.scale or defaults.scale
    size = (scale or 1.0,) * 3
    shape = Shape(kind=suffix(file), size=size, blob=0)
    job = Job(collision=(shape,), guess_units=scale is None)
    return Source(job=job, blobs=(data,), sha256=digest(data), family=family)


def referenced(root: Path, files: Sequence[str]) -> set[str]:
    """Return the files that are parts of URDFs, and no objects of their own."""
    found = set[str]()
    for file in files:
        if suffix(file) == "urdf":
            try:
                names = parse_urdf(read_inside(root, file)).files
            except UnusableError:
                continue
            for name in names:
                found.update(_options(name, file))
    return found & set(files)


def _options(name: str, file: str) -> tuple[str, ...]:
    try:
        return mesh_file(name, file)
    except UnusableError:
        return ()


def _of_urdf(root: Path, file: str, data: bytes, scale: float, family: str) -> Source:
    urdf = parse_urdf(data)
    needed, visual = _used(urdf.collision), urdf.visual
    notes: tuple[str, ...] = ()
    blobs = {i: _read_mesh(root, urdf.files[i], file) for i in needed}
    try:
        blobs |= {i: _read_mesh(root, urdf.files[i], file) for i in _used(visual) - needed}
    except UnusableError as error:
        visual, notes = (), (f"seen as it collides, for {error}",)
    job = Job(
        collision=tuple(_scaled(shape, scale) for shape in urdf.collision),
        visual=tuple(_scaled(shape, scale) for shape in visual),
    )
    hashes = sorted({digest(blobs[i]) for i in needed})
    if len(hashes) == 1:
        sha256 = hashes[0]
    else:
        sha256 = digest("".join(hashes).encode() or data)
    return Source(
        job=job,
        blobs=tuple(blobs.get(i, b"") for i in range(len(urdf.files))),
        sha256=sha256,
        family=family,
        urdf=urdf,
        scale=scale,
        warnings=notes,
    )


def _read_mesh(root: Path, name: str, urdf: str) -> bytes:
    options = mesh_file(name, urdf)
    for option in options:
        if os.path.lexists(root / option):
            try:
                return read_inside(root, option)
            except UnusableError as error:
                raise UnusableError(f"its mesh {shown(name)}: {error}") from None
    raise UnusableError(f"its mesh {shown(name)} is not in the folder")


def _used(shapes: Iterable[Shape]) -> set[int]:
    return {shape.blob for shape in shapes if shape.blob >= 0}


def _scaled(shape: Shape, scale: float) -> Shape:
    (a, b, c), (x, y, z) = shape.size, shape.position
    return dataclasses.replace(
        shape,
        size=(a * scale, b * scale, c * scale),
        position=(x * scale, y * scale, z * scale),
    )
