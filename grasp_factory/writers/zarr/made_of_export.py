"""The root attribute of a store that was made of an export: format, and arrays that it lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from grasp_factory.errors import shown

IMPORTED = "imported"


def imported(format_name: str, not_held: Sequence[str]) -> dict[str, Any]:
    """Return the attribute, as a dict with its name."""
    return {IMPORTED: {"format": format_name, "not_held": list(not_held)}}


def arrays_not_held(attributes: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the paths of arrays that hold nothing, because the export did not have them."""
    found = attributes.get(IMPORTED)
    paths = found.get("not_held") if isinstance(found, Mapping) else None
    return tuple(map(str, paths)) if isinstance(paths, list) else ()


def import_note(attributes: Mapping[str, Any]) -> str:
    """Return a sentence on what the store lacks; empty if it lacks nothing."""
    lacks = arrays_not_held(attributes)
    if not lacks:
        return ""
    return (
        f"the store was imported from {shown(attributes[IMPORTED].get('format'))}, without"
        f" {len(lacks)} of its arrays: {shown(', '.join(lacks))}"
    )
