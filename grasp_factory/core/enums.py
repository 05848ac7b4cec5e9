"""The enumerations of an episode: outcomes, phases, and labels of pixels and contacts."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

UNKNOWN = 255
"""Value of a code that was not measured."""


class Word(IntEnum):
    """An integer code with a name, which is what ``str``, ``print`` and f-strings show.

    It equals its name too: ``episode.outcome == "success"``. Sets and dicts find it by
    its code only.
    """

    def __str__(self) -> str:
        return self.name.lower()

    def __format__(self, spec: str) -> str:
        return format(str(self), spec)

    def __eq__(self, other: object) -> bool:
        return str(self) == other if isinstance(other, str) else int(self) == other

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = IntEnum.__hash__


class Outcome(Word):
    """How an attempt ended. The values are stored in datasets: append new ones, never reorder."""

    SUCCESS = 0
    NEVER_SETTLED = 1
    """The object was still moving at the end of the settling time."""
    LEFT_WORKSPACE = 2
    """The object came to rest outside the workspace, or fell off the table during the attempt."""
    NO_PLAN = 3
    """The policy proposed no grasp, for example because it saw no target."""
    UNREACHABLE = 4
    """The robot has no joint path to any proposed grasp."""
    COLLISION = 5
    """The robot touched something before the gripper closed."""
    NO_CONTACT = 6
    """The gripper closed without both pads touching the target."""
    LOST_IN_LIFT = 7
    """Both pads touched the target, but it was lost before the lift ended."""
    LOST_IN_HOLD = 8
    """The target was up when the lift ended, but it was lost by the end of the hold."""
    LOST_IN_SHAKE = 9
    """The target was held, but lost at a level of the shake that success requires."""
    UNSTABLE = 10
    """The target stayed in the hand, but the grip was too weak or it moved too far for success."""


class Phase(Word):
    """The part of an attempt that a record belongs to. Stored: append new ones, never reorder."""

    PREGRASP = 0
    APPROACH = 1
    CLOSE = 2
    LIFT = 3
    HOLD = 4
    SHAKE = 5


class Label(Word):
    """The body at a pixel or contact: labels of the scene, independent of the simulator's ids."""

    BACKGROUND = 0
    FLOOR = 1
    TABLE = 2
    ARM = 3
    GRIPPER = 4
    TARGET = 5
    """The labels of other objects are 6, 7, ..."""


def label_names(objects: int) -> list[str]:
    """Return the label names for scenes with this number of objects; a position is a value.

    After the target follow object_1, object_2, ...: the number is the index in a recipe's objects.
    """
    return [*names(Label), *(f"object_{i}" for i in range(1, objects))]


def names(words: type[IntEnum]) -> list[str]:
    """Return the names of an enumeration in lower case; the position of a name is its value."""
    return [word.name.lower() for word in words]


def word_of(code: int, words: Sequence[str]) -> str | None:
    """Return the name of a code; None for one that was not measured.

    Args:
        code: the value in the store.
        words: the names; the position of a name is its value.
    """
    return None if code == UNKNOWN else words[code]
