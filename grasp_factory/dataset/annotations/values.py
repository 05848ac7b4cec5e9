"""The kinds of changes to an annotation, and the values that each kind takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.serialization import check, from_plain, is_integer, to_plain
from grasp_factory.dataset.annotations.records import Mark
from grasp_factory.dataset.annotations.text import checked_lines, checked_text
from grasp_factory.errors import lookup, shown

LONGEST_TAG, LONGEST_NOTE, LONGEST_NAME = 64, 4000, 64
BEST_QUALITY = 5


def checked(kind: Any, value: Any) -> Any:
    """Return the value of a change as it is stored: JSON data, with text in Unicode form NFC.

    Raises:
        UnknownNameError: for an unknown kind, listing the valid ones.
        ConfigError: for a value that the kind does not take.
    """
    return lookup(KINDS, "kind of change", kind if isinstance(kind, str) else shown(kind))(value)


def checked_tag(value: Any) -> str:
    """Return a tag as it is stored.

    Raises:
        ConfigError: if it is invalid.
    """
    return checked_text("tag", value, LONGEST_TAG, without=",")


def checked_who(value: Any) -> str:
    """Return a person's name as it is stored.

    Raises:
        ConfigError: if it is invalid.
    """
    return checked_text("who", value, LONGEST_NAME)


def _note(value: Any) -> str:
    return checked_lines("note", value, LONGEST_NOTE)


def _quality(value: Any) -> int | None:
    ok = value is None or (is_integer(value) and 1 <= value <= BEST_QUALITY)
    check(ok, "quality", value, f"1 to {BEST_QUALITY}, or none")
    return None if value is None else int(value)


def _outcome(value: Any) -> str | None:
    words = names(Outcome)
    ok = value is None or (isinstance(value, str) and value in words)
    check(ok, "outcome", value, f"{', '.join(words)}, or none")
    return None if value is None else str(value)


def _mark(value: Any) -> dict[str, Any]:
    mark: dict[str, Any] = to_plain(from_plain(Mark, value, "mark"))
    return mark


def _unmark(value: Any) -> str:
    return checked_text("unmark", value, 12)


KINDS: Mapping[str, Callable[[Any], Any]] = MappingProxyType(
    {
        "tag": checked_tag,
        "untag": checked_tag,
        "note": _note,
        "quality": _quality,
        "outcome": _outcome,
        "mark": _mark,
        "unmark": _unmark,
    }
)
"""Kinds of changes, with the function that checks and returns the value of each."""
