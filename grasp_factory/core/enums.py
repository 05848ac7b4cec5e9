"""The coded words of an episode: how it ended, its phases, and what a pixel or contact shows."""

from __future__ import annotations

from enum import IntEnum


class Outcome(IntEnum):
    """How an attempt ended. The values are stored: append, never reorder."""

    SUCCESS = 0
    NEVER_SETTLED = 1
    """The object was still moving when the settling time was over."""
    LEFT_WORKSPACE = 2
    """The object came to rest outside the workspace, or fell off the table in the attempt."""
    NO_PLAN = 3
    """The policy proposed no grasp, for instance because it saw no target."""
    UNREACHABLE = 4
    """The robot has no joint path to any proposed grasp."""
    COLLISION = 5
    """Something was touched before the gripper closed."""
    NO_CONTACT = 6
    """The gripper closed without both pads touching the target."""
    LOST_IN_LIFT = 7
    """Both pads touched the target, and it was lost before the lift ended."""
    LOST_IN_HOLD = 8
    """The target was up when the lift ended and lost by the end of the hold."""
    LOST_IN_SHAKE = 9
    """The target was held, and lost at a level of the shake that success demands."""
    UNSTABLE = 10
    """The target stayed in the hand, but gripped too weakly or moved too far for the label."""


class Phase(IntEnum):
    """The part of an attempt that a record belongs to. Stored: append, never reorder."""

    PREGRASP = 0
    APPROACH = 1
    CLOSE = 2
    LIFT = 3
    HOLD = 4
    SHAKE = 5


class Label(IntEnum):
    """What a pixel or a contact shows: stable scene labels, not the simulator's ids."""

    BACKGROUND = 0
    FLOOR = 1
    TABLE = 2
    ARM = 3
    GRIPPER = 4
    TARGET = 5
    """Other objects follow: 6, 7, ..."""


def label_names(objects: int) -> list[str]:
    """Return the words of ``Label`` for scenes of so many objects; a word's position is its value.

    After the target come object_1, object_2, ...: their numbers are those of a recipe's objects.
    """
    return [*names(Label), *(f"object_{i}" for i in range(1, objects))]


def names(words: type[IntEnum]) -> list[str]:
    """Return the words in lower case; a word's position is its value."""
    return [word.name.lower() for word in words]
