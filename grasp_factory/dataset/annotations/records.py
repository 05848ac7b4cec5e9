"""The annotation of an episode by people, and one change of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.serialization import check, normalise
from grasp_factory.dataset.annotations.text import checked_text

SHAPES = {"box": 4, "point": 2}
"""Shapes of marks, with how many numbers each has."""
LONGEST_LABEL = 64
_ID = re.compile(r"[0-9a-f]{12}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One change that a person made to the annotation of one episode."""

    when: str
    """UTC, ISO 8601 with milliseconds: 2026-01-31T08:15:00.250Z."""
    who: str
    row: int
    kind: str
    """One of ``KINDS``."""
    value: Any
    """JSON data, whose type depends on the kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A box or a point on a stored image.

    Its coordinates are pixels from the image's upper left corner. The centre of the first pixel is
    at (0.5, 0.5), and the lower right corner of the image is at (width, height).
    """

    id: str
    """12 hexadecimal digits; a new mark replaces an older mark with the same id."""
    camera: str
    frame: int
    """0 for the image before the attempt, 1 for the one after."""
    shape: str
    """``box`` or ``point``."""
    label: str
    pixels: tuple[float, ...]
    """A box: x and y of its upper left corner, width, height; a point: x, y."""

    def __post_init__(self) -> None:
        """Check everything that does not depend on the store.

        Raises:
            ConfigError: naming the field, its value and what is valid.
        """
        normalise(self)
        check(bool(_ID.fullmatch(self.id)), "id", self.id, "12 hexadecimal digits")
        check(self.frame in (0, 1), "frame", self.frame, "0 (before) or 1 (after)")
        check(self.shape in SHAPES, "shape", self.shape, ", ".join(SHAPES))
        label = checked_text("label", self.label, LONGEST_LABEL, least=0)
        object.__setattr__(self, "label", label)
        count = SHAPES[self.shape]
        check(len(self.pixels) == count, "pixels", self.pixels, f"{count} numbers")
        check(min(self.pixels) >= 0, "pixels", self.pixels, "0 or more")
        sides = self.pixels[2:]
        check(not sides or min(sides) > 0, "pixels", self.pixels, "a box with sides above 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class Annotation:
    """The current annotation of one episode."""

    row: int
    tags: tuple[str, ...] = ()
    """Sorted."""
    note: str = ""
    quality: int | None = None
    """1 (bad) to 5 (good)."""
    outcome: str | None = None
    """The corrected label: a name of ``Outcome``, in lower case."""
    marks: tuple[Mark, ...] = ()
    """In the order in which they were first set."""
    changed: str = ""
    """Time of the last change, in the format of ``Change.when``."""
    by: str = ""
    """Name of the person who made the last change."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is set."""
        return not (self.tags or self.note or self.quality or self.outcome or self.marks)
