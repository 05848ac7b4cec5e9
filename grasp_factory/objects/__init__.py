"""Object sets: what can be dropped. A new set is one file and one row in the table below."""

from __future__ import annotations

from collections.abc import Mapping

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
from grasp_factory.objects.visual import visual_parts

OBJECT_SETS: Mapping[str, ObjectSet] = {s.name: s for s in (BLOBS, CLASSIC)}

__all__ = [
    "MAX_PARTS",
    "OBJECT_SETS",
    "Compound",
    "FiniteSet",
    "ObjectModel",
    "ObjectSet",
    "Part",
    "UrdfFile",
    "visual_parts",
]
