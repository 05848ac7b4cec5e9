"""What an object is, as data: the scene loads it, the sampler draws it."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.geometry import Array

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectModel:
    """One object that can be dropped."""

    object_id: str
    """Unique over all sets."""
    urdf: str
    """Path inside ``pybullet_data``."""
    lower: Vector3
    """Corner of the bounding box in the object's own frame, metres."""
    upper: Vector3
    mass: float
    """kg."""
    lateral_friction: float

    @property
    def split(self) -> str:
        """``train``, ``val`` or ``test`` (80, 10, 10 %).

        It hangs on the id alone, so that it stays when a set grows.
        """
        share = int.from_bytes(hashlib.sha256(self.object_id.encode()).digest()[:8]) / 2**64
        return "train" if share < 0.8 else "val" if share < 0.9 else "test"

    def corners(self) -> Array:
        """Return the corners of the bounding box, (8, 3) metres, object frame."""
        return np.array(list(itertools.product(*zip(self.lower, self.upper, strict=True))))


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSet:
    """A named family of objects."""

    name: str
    description: str
    models: Mapping[str, ObjectModel]
    """By object id, in a fixed order."""
