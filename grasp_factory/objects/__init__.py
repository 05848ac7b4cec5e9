"""Define the objects that can be dropped, and import meshes.

A new object set is one file and one row in ``OBJECT_SETS``.
"""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.errors import lookup
from grasp_factory.objects.base import (
    MAX_PARTS,
    Compound,
    FiniteSet,
    ObjectModel,
    ObjectSet,
    Part,
    UrdfFile,
)
from grasp_factory.objects.blobs import BLOBS
from grasp_factory.objects.classic import CLASSIC
from grasp_factory.objects.folder import load_folder
from grasp_factory.objects.procedural import PROCEDURAL
from grasp_factory.objects.split_sets import check_splits, draw_of
from grasp_factory.objects.visual import visual_parts

OBJECT_SETS: Mapping[str, ObjectSet] = {s.name: s for s in (BLOBS, CLASSIC, PROCEDURAL)}


def find_set(name: str, folder_sha256: str = "") -> ObjectSet:
    """Return a set of the table, or the user's set with that digest of its contents.

    Raises:
        UnknownNameError: naming the nearest and all valid names.
        ConfigError: if the user's set has not been imported on this machine.
    """
    if folder_sha256:
        return load_folder(name, folder_sha256)
    return lookup(OBJECT_SETS, "object set", name)


__all__ = [
    "MAX_PARTS",
    "OBJECT_SETS",
    "Compound",
    "FiniteSet",
    "ObjectModel",
    "ObjectSet",
    "Part",
    "UrdfFile",
    "check_splits",
    "draw_of",
    "find_set",
    "visual_parts",
]
