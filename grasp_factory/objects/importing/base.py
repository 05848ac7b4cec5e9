"""The records that an import returns, and the error for an unusable object."""

from __future__ import annotations

from dataclasses import dataclass

from grasp_factory.core.geometry import Vector3
from grasp_factory.errors import GraspFactoryError


class UnusableError(GraspFactoryError):
    """An object that cannot be used; the message is the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedObject:
    """An object that can be used."""

    object_id: str
    file: str
    """Its path in the folder."""
    sides: Vector3
    """Metres, ascending: the narrowest width, and the two sides at right angles to it."""
    mass: float
    """kg."""
    parts: int
    """Number of convex collision parts."""
    split: str
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """A file that cannot be used."""

    file: str
    """Its path in the folder, not escaped: it may contain terminal control sequences."""
    reason: str
    """One line of printable characters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FolderReport:
    """The result for every object of a folder."""

    name: str
    """Name of the object set."""
    sha256: str
    """Digest of the usable objects, for ``load_folder``; independent of the folder's path."""
    usable: tuple[ImportedObject, ...]
    refused: tuple[Refusal, ...]
    warnings: tuple[str, ...] = ()
    """About the folder as a whole."""
