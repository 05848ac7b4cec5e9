"""The imported objects of a user's folder: a manifest and meshes in the cache."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from grasp_factory.core.cache import cache_dir, is_digest, read_checked
from grasp_factory.core.geometry import Pose, QuatXyzw, Vector3
from grasp_factory.core.json_text import parsed
from grasp_factory.core.serialization import check, check_range, from_plain, to_plain
from grasp_factory.errors import ConfigError, shown
from grasp_factory.objects.base import MAX_PARTS, PRIMITIVES, Compound, FiniteSet, ObjectModel, Part
from grasp_factory.objects.folder_cache import manifest_path, mesh_path

FORMAT = 1
"""Version of the manifest."""
MAX_PRIMITIVES = MAX_PARTS - 1
"""Primitives of an object; its mesh file is one more part."""
MAX_REACH = 2.0
"""Metres from an object's origin to any point of it, along each axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConvexPart:
    """A primitive of an object."""

    shape: str
    size: Vector3
    """As in ``Part``."""
    position: Vector3
    quat_xyzw: QuatXyzw

    def __post_init__(self) -> None:
        check(self.shape in PRIMITIVES, "shape", self.shape, ", ".join(PRIMITIVES))
        check(all(0.0 < side <= MAX_REACH for side in self.size), "size", self.size, "0 to 2 m")
        _check_reach("position", self.position)
        _check_unit("quat_xyzw", self.quat_xyzw)


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """Shape and mass distribution of an object, for any mass; metres, in the object's own frame."""

    lower: Vector3
    upper: Vector3
    com: Vector3
    axes_xyzw: QuatXyzw
    """The principal axes."""
    gyration_squared: Vector3
    """As in ``Compound``."""
    collision: str = ""
    """SHA-256 of the OBJ file with the convex parts; empty if there are only primitives."""
    visual: str = ""
    """SHA-256 of the visual OBJ file; empty if the primitives are rendered."""
    solids: tuple[ConvexPart, ...] = ()
    hulls: int = 0
    """Number of convex parts in the collision file."""

    def __post_init__(self) -> None:
        for key in ("lower", "upper", "com"):
            _check_reach(key, getattr(self, key))
        pairs = zip(self.lower, self.upper, strict=True)
        check(all(low < high for low, high in pairs), "upper", self.upper, "more than lower")
        _check_unit("axes_xyzw", self.axes_xyzw)
        ok = all(0.0 < square <= MAX_REACH * MAX_REACH for square in self.gyration_squared)
        check(ok, "gyration_squared", self.gyration_squared, "above 0")
        for key in ("collision", "visual"):
            got = getattr(self, key)
            check(not got or is_digest(got), key, got, "a SHA-256")
        ok = bool(self.collision) <= bool(self.visual) and bool(self.collision or self.solids)
        check(ok, "collision", self.collision, "a file, and one to see, or solids")
        check(len(self.solids) <= MAX_PRIMITIVES, "solids", len(self.solids), "up to 15")

    @property
    def files(self) -> tuple[str, ...]:
        """The SHA-256 of each mesh file."""
        return tuple(sha256 for sha256 in (self.collision, self.visual) if sha256)


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderObject:
    """One object of an imported folder."""

    family: str
    shape_sha256: str
    """Digest of its shape, independent of size, format and name; the split depends on it."""
    mass: float
    """kg."""
    lateral_friction: float
    color: Vector3
    """RGB in 0 to 1."""
    geometry: Geometry

    def __post_init__(self) -> None:
        _check_name("family", self.family)
        check(is_digest(self.shape_sha256), "shape_sha256", self.shape_sha256, "a SHA-256")
        check_range(self, "mass", 1e-4, 10.0, "kg")
        check_range(self, "lateral_friction", 0.0, 10.0)
        check(all(0.0 <= c <= 1.0 for c in self.color), "color", self.color, "0 to 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Everything that decides how the objects of a folder behave and look."""

    format: int = FORMAT
    objects: Mapping[str, FolderObject]
    """By id without the set's name."""

    def __post_init__(self) -> None:
        check(self.format == FORMAT, "format", self.format, str(FORMAT))
        for key in self.objects:
            _check_name("objects", key)

    def encoded(self) -> bytes:
        """Return the manifest as JSON text; equal content has the same text."""
        return json.dumps(to_plain(self), sort_keys=True, separators=(",", ":")).encode()

    @classmethod
    def decoded(cls, data: bytes) -> Manifest:
        """Return the manifest that a JSON text contains.

        Raises:
            ConfigError: if the text is not a valid manifest.
        """
        try:
            return from_plain(cls, parsed(data), "manifest")
        except ValueError as error:
            raise ConfigError(f"no manifest of objects: {str(error)[:300]}") from None

    @property
    def files(self) -> tuple[str, ...]:
        """The SHA-256 of each mesh file, sorted."""
        objects = self.objects.values()
        return tuple(sorted({sha256 for item in objects for sha256 in item.geometry.files}))


def load_folder(name: str, sha256: str) -> FiniteSet:
    """Return the object set of an imported folder.

    Args:
        name: the set's name, with which the ids of its objects begin.
        sha256: the digest of its manifest, as the import returned it.

    Raises:
        ConfigError: if this machine's cache does not have all of it undamaged.
    """
    return _load(name, sha256, cache_dir())


def read_manifest(sha256: str, where: Path) -> Manifest:
    """Return the manifest of an imported folder.

    Raises:
        ConfigError: if the cache ``where`` does not have it undamaged.
    """
    data = read_checked(manifest_path(where, sha256)) if is_digest(sha256) else None
    if data is None:
        raise ConfigError(
            f"the cache {where} has no imported objects with the digest {shown(sha256)}; run"
            " `grasp-factory objects DIR` on the folder with the meshes"
        )
    return Manifest.decoded(data)


@cache
def _load(name: str, sha256: str, where: Path) -> FiniteSet:
    manifest = read_manifest(sha256, where)
    for file in manifest.files:
        if read_checked(mesh_path(where, file)) is None:
            raise ConfigError(
                f"the cache {where} has lost or damaged a mesh of object set {name!r}; run"
                " `grasp-factory objects DIR` again to convert it again"
            )
    models = (_model(f"{name}/{key}", item, where) for key, item in manifest.objects.items())
    return FiniteSet(
        name=name,
        description=f"{len(manifest.objects)} objects of a user's folder",
        models={model.object_id: model for model in models},
    )


def _model(object_id: str, item: FolderObject, where: Path) -> ObjectModel:
    body = item.geometry
    parts = [
        Part(shape=s.shape, size=s.size, pose=Pose(s.position, s.quat_xyzw)) for s in body.solids
    ]
    if body.collision:
        parts.append(_mesh(body.collision, where))
    return ObjectModel(
        object_id=object_id,
        family=item.family,
        body=Compound(
            parts=tuple(parts),
            visual=(_mesh(body.visual, where),) if body.visual else (),
            inertial_frame=Pose(body.com, body.axes_xyzw),
            gyration_squared=body.gyration_squared,
        ),
        lower=body.lower,
        upper=body.upper,
        mass=item.mass,
        lateral_friction=item.lateral_friction,
        color=item.color,
        split_by=item.shape_sha256,
    )


def _mesh(sha256: str, where: Path) -> Part:
    return Part(shape=str(mesh_path(where, sha256)), size=(1.0, 1.0, 1.0))


def _check_reach(key: str, point: Vector3) -> None:
    check(all(abs(v) <= MAX_REACH for v in point), key, point, f"within {MAX_REACH} m")


def _check_unit(key: str, quaternion: QuatXyzw) -> None:
    ok = abs(sum(v * v for v in quaternion) - 1.0) < 2e-6
    check(ok, key, quaternion, "a unit quaternion")


def _check_name(key: str, name: str) -> None:
    check(0 < len(name) <= 1000 and name.isprintable(), key, name, "printable characters")
