"""The data of an object: the sampler draws an object, and the scene loads it."""

from __future__ import annotations

import abc
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from grasp_factory.core.geometry import IDENTITY, Array, Pose, Vector3
from grasp_factory.core.splits import split_of
from grasp_factory.errors import lookup

MAX_PARTS = 16
"""Collision parts of a compound; with more, PyBullet 3.2.7 crashes the process."""
MAX_HULLS = 64
"""Convex parts in a mesh file: contact time is proportional to their number."""
PRIMITIVES = ("box", "sphere", "cylinder", "capsule")
"""Shapes that the engine represents exactly; the axis of cylinders and capsules is z."""
GREY = (0.6, 0.6, 0.6)


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A convex solid, or several in one mesh file, fixed in an object."""

    shape: str
    """One of ``PRIMITIVES``, or the path of an OBJ file in which each ``o`` group is convex."""
    size: Vector3
    """Sides of a primitive's bounding box, metres; for a mesh file, the scale of each axis."""
    pose: Pose = IDENTITY
    """In the object's own frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UrdfFile:
    """A body that ``pybullet_data`` ships; the engine's loader sets its shapes and inertia."""

    path: str
    """Relative to the folder of ``pybullet_data``."""
    scale: float = 1.0
    """Factor by which the size in the file is multiplied."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compound:
    """A rigid body that consists of parts, with exact mass properties."""

    parts: tuple[Part, ...]
    """The collision shapes, up to ``MAX_PARTS``."""
    visual: tuple[Part, ...] = ()
    """The visual shapes; if empty, ``parts`` are rendered."""
    inertial_frame: Pose = IDENTITY
    """Centre of mass and principal axes, in the object's own frame."""
    gyration_squared: Vector3
    """Principal moments of inertia over the mass, m2, along the inertial frame's axes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectModel:
    """One object that can be dropped."""

    object_id: str
    """Unique over all sets; it begins with the set's name and a slash."""
    family: str
    """The kind of shape in one word, such as box, mug or blob."""
    body: UrdfFile | Compound
    lower: Vector3
    """Corner of the bounding box in the object's own frame, metres."""
    upper: Vector3
    mass: float
    """kg."""
    lateral_friction: float
    color: Vector3 | None = None
    """RGB in 0 to 1; None if the body's file has its own colours."""
    split_by: str = ""
    """Key of the split, if two ids may be the same object; if empty, the id is the key."""

    @property
    def split(self) -> str:
        """``train``, ``val`` or ``test`` (80, 10, 10 %).

        It depends on the object alone, so it does not change when a set grows.
        """
        return split_of(self.split_by or self.object_id)

    def corners(self) -> Array:
        """Return the corners of the bounding box, (8, 3) metres, object frame."""
        return np.array(list(itertools.product(*zip(self.lower, self.upper, strict=True))))


class ObjectSet(abc.ABC):
    """A named set of objects, finite or not."""

    name: str
    description: str

    @property
    @abc.abstractmethod
    def families(self) -> tuple[str, ...]:
        """Every family in the set, sorted."""

    @property
    @abc.abstractmethod
    def size(self) -> int | None:
        """The number of objects; None if it is unlimited."""

    @abc.abstractmethod
    def draw(self, rng: np.random.Generator) -> ObjectModel:
        """Draw an object; the same generator state yields the same object."""

    @abc.abstractmethod
    def model(self, object_id: str) -> ObjectModel:
        """Return an object by its id.

        Raises:
            UnknownNameError: if the set has no such object.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class FiniteSet(ObjectSet):
    """A set whose objects are listed; all are equally likely."""

    name: str
    description: str
    models: Mapping[str, ObjectModel] = field(repr=False)
    """By object id, in a fixed order."""

    @property
    def families(self) -> tuple[str, ...]:
        """See ``ObjectSet.families``."""
        return tuple(sorted({model.family for model in self.models.values()}))

    @property
    def size(self) -> int:
        """See ``ObjectSet.size``."""
        return len(self.models)

    def draw(self, rng: np.random.Generator) -> ObjectModel:
        """See ``ObjectSet.draw``."""
        return list(self.models.values())[int(rng.integers(len(self.models)))]

    def model(self, object_id: str) -> ObjectModel:
        """See ``ObjectSet.model``."""
        return lookup(self.models, f"object of set {self.name!r}", object_id)
