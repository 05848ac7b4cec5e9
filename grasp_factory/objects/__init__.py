"""Object sets: what can be dropped. A new set is one file and one row in the table below."""

from __future__ import annotations

from collections.abc import Mapping

from grasp_factory.objects.base import ObjectModel, ObjectSet
from grasp_factory.objects.blobs import BLOBS
from grasp_factory.objects.classic import CLASSIC

OBJECT_SETS: Mapping[str, ObjectSet] = {s.name: s for s in (BLOBS, CLASSIC)}

__all__ = ["OBJECT_SETS", "ObjectModel", "ObjectSet"]
