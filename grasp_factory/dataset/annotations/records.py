"""What is known of an episode from people, and one change of it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.serialization import check, normalise
from grasp_factory.dataset.annotations.text import checked_text

SHAPES = {"box": 4, "point": 2}
"""Shapes of marks, with how many numbers they have."""
LONGEST_LABEL = 64
_ID = re.compile(r"[0-9a-f]{12}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """One thing that a person said of one episode."""

    when: str
    """UTC, ISO 8601 with milliseconds: 2026-01-31T08:15:00.250Z."""
    who: str
    row: int
    kind: str
    """One of ``KINDS``."""
    value: Any
    """JSON data; what it is depends on the kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """A box or a point on a stored image.

    Its pixels are counted from the image's upper left corner, so that the middle of the first pixel
    is at (0.5, 0.5) and the lower right corner at (width, height).
    """

    id: str
    """12 hexadecimal digits; a mark with the id of another one takes its place."""
    camera: str
    frame: int
    """0 for the image before the attempt, 1 for the one after."""
    shape: str
    """``box`` or ``point``."""
    label: str
    pixels: tuple[float, ...]
    """A box: x and y of its upper left corner, width, height; a point: x, y."""

    def __post_init__(self) -> None:
        """Check all but what only the store knows.

        Raises:
            ConfigError: naming the field, what it got and what is valid.
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
    """All that people have said of one episode, as it stands."""

    row: int
    tags: tuple[str, ...] = ()
    """Sorted."""
    note: str = ""
    quality: int | None = None
    """1 (bad) to 5 (good)."""
    outcome: str | None = None
    """A corrected label, a word of ``Outcome``."""
    marks: tuple[Mark, ...] = ()
    """In the order in which they were first set."""
    changed: str = ""
    """When it last was."""
    by: str = ""
    """Who did that."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is set."""
        return not (self.tags or self.note or self.quality or self.outcome or self.marks)
