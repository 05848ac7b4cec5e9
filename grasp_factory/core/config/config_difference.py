"""Where two configs, or other plain data, differ first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from grasp_factory.errors import shown


def first_difference(a: Any, b: Any) -> str | None:
    """Return ``key: a's value against b's`` for the first difference of two plain configs."""
    found = differing_values(a, b)
    return found and "{}: {} against {}".format(*found)


def differing_values(a: Any, b: Any, where: str = "") -> tuple[str, str, str] | None:
    """Return the dotted key and both values, as short texts, where two plain configs differ first.

    None for equal configs.
    """
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in [*a, *(k for k in b if k not in a)]:
            here = f"{where}.{key}" if where else str(key)
            if key not in a or key not in b:
                left, right = (shown(side.get(key, "absent")) for side in (a, b))
                return here, left, right
            found = differing_values(a[key], b[key], here)
            if found:
                return found
        return None
    return None if a == b else (where, shown(a), shown(b))
