"""Create an object from its id: ``procedural/<family>/<number>`` is always the same object."""

from __future__ import annotations

import colorsys
import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from grasp_factory.errors import UnknownNameError, lookup, shown
from grasp_factory.objects.base import ObjectModel, ObjectSet
from grasp_factory.objects.procedural import joined, single, vessels
from grasp_factory.objects.procedural.parts import Parts, between
from grasp_factory.objects.solids import bounds, compound

GENERATOR = 1
"""Version of the draws. Increase it when any family's draws change, because ids then mean other
objects."""
NUMBERS = 2**31
"""Number of objects of a family."""

SOLID = (150.0, 1200.0)
"""kg/m3: balsa (160, USDA Wood Handbook) to polycarbonate (1200, ISO 1183 data sheets)."""
HOLLOW = (900.0, 2400.0)
"""kg/m3, for thin walls: polypropylene (900, same sheets) to porcelain (2400)."""
MASSES = (0.02, 0.5)
"""kg. Masses are clamped to this range, so some objects are denser or lighter than the material."""
FRICTIONS = (0.3, 0.8)
"""Coulomb's coefficient, slippery to rough. The pads' own is 1, so this is also the pair's."""


@dataclass(frozen=True, slots=True)
class Family:
    """A kind of shape with free parameters."""

    draw: Callable[[np.random.Generator], Parts]
    densities: tuple[float, float] = SOLID
    """kg/m3."""


FAMILIES: Mapping[str, Family] = {
    "bottle": Family(vessels.draw_bottle),
    "box": Family(single.draw_box),
    "capsule": Family(single.draw_capsule),
    "channel": Family(joined.draw_channel),
    "cross": Family(joined.draw_cross),
    "cylinder": Family(single.draw_cylinder),
    "dumbbell": Family(joined.draw_dumbbell),
    "ell": Family(joined.draw_ell),
    "ellipsoid": Family(single.draw_ellipsoid),
    "frustum": Family(single.draw_frustum),
    "hammer": Family(joined.draw_hammer),
    "mug": Family(vessels.draw_mug, HOLLOW),
    "pan": Family(vessels.draw_pan, HOLLOW),
    "prism": Family(single.draw_prism),
    "ring": Family(single.draw_ring),
    "sphere": Family(single.draw_sphere),
    "tee": Family(joined.draw_tee),
    "wedge": Family(single.draw_wedge),
    "zed": Family(joined.draw_zed),
}
"""In alphabetical order: ``draw`` chooses by index."""


class ProceduralSet(ObjectSet):
    """All families of ``FAMILIES``; they are equally likely."""

    name = "procedural"
    description = "shapes without end: boxes, rings, hammers, mugs, bottles and more, all drawn"

    @property
    def families(self) -> tuple[str, ...]:
        """See ``ObjectSet.families``."""
        return tuple(FAMILIES)

    @property
    def size(self) -> None:
        """See ``ObjectSet.size``."""
        return None

    def draw(self, rng: np.random.Generator) -> ObjectModel:
        """See ``ObjectSet.draw``."""
        family = self.families[int(rng.integers(len(FAMILIES)))]
        return self.model(f"{self.name}/{family}/{int(rng.integers(NUMBERS))}")

    def model(self, object_id: str) -> ObjectModel:
        """See ``ObjectSet.model``."""
        match = re.fullmatch(rf"{self.name}/([^/]+)/(0|[1-9][0-9]{{0,9}})", object_id)
        if not match or int(match[2]) >= NUMBERS:
            raise UnknownNameError(
                f"unknown object of set {self.name!r} {shown(object_id)} "
                f"(valid: {self.name}/<family>/<number from 0 to {NUMBERS - 1}>)"
            )
        lookup(FAMILIES, f"family of set {self.name!r}", match[1])
        return _build(object_id, match[1], int(match[2]))


PROCEDURAL = ProceduralSet()


def _build(object_id: str, family: str, number: int) -> ObjectModel:
    """Draw all properties of an object with its id as the seed."""
    key = int.from_bytes(hashlib.sha256(family.encode()).digest()[:8])
    rng = np.random.default_rng(np.random.SeedSequence([GENERATOR, key, number]))
    body, volume = compound(FAMILIES[family].draw(rng))
    lower, upper = bounds(body.parts)
    mass = volume * between(rng, *FAMILIES[family].densities)
    return ObjectModel(
        object_id=object_id,
        family=family,
        body=body,
        lower=lower,
        upper=upper,
        mass=min(max(mass, MASSES[0]), MASSES[1]),
        lateral_friction=between(rng, *FRICTIONS),
        color=colorsys.hsv_to_rgb(
            between(rng, 0.0, 1.0), between(rng, 0.2, 0.9), between(rng, 0.4, 0.95)
        ),
    )
