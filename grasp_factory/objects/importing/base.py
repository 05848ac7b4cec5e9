"""What an import returns, and why an object is refused."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.geometry import Vector3
from grasp_factory.errors import GraspFactoryError

MESH_SUFFIXES = ("obj", "stl", "ply")
SUFFIXES = (*MESH_SUFFIXES, "urdf")


class UnusableError(GraspFactoryError):
    """An object that cannot be used; the message is the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedObject:
    """An object that can be used."""

    object_id: str
    file: str
    """Its path in the folder."""
    sides: Vector3
    """Metres, ascending: the narrowest width and the two across it."""
    mass: float
    """kg."""
    parts: int
    """Convex parts that collide."""
    split: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A file that cannot be used."""

    file: str
    """Its path in the folder, as it is: it may hold what a terminal takes for a command."""
    reason: str
    """In one line that can be printed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderReport:
    """What became of every object of a folder."""

    name: str
    """Of the object set."""
    sha256: str
    """Digest of the usable objects, for ``load_folder``; the folder's place is not in it."""
    usable: tuple[ImportedObject, ...]
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...] = ()
    """About the folder as a whole."""
