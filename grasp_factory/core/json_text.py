"""JSON documents from files: of a limited depth, so that code that descends into them ends."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from grasp_factory.errors import ConfigError

DEEPEST = 64
"""Levels of lists and mappings in each other. This package writes fewer than ten."""


def parsed(text: str | bytes) -> Any:
    """Return the plain data of a JSON text.

    Raises:
        ValueError: if it is no JSON, or nested too deep.
    """
    try:
        data = json.loads(text)
    except RecursionError:
        raise _too_deep("a document") from None
    brackets = (b"[", b"{") if isinstance(text, bytes) else ("[", "{")
    if sum(map(text.count, brackets)) > DEEPEST:  # type: ignore[arg-type]
        check_depth("a document", data)
    return data


def check_depth(what: str, data: Any) -> None:
    """Check that plain data is not nested too deep.

    Raises:
        ConfigError: if it is.
    """
    level = [data]
    for _ in range(DEEPEST + 1):
        level = [item for value in level for item in _items(value)]
        if not level:
            return
    raise _too_deep(what)


def _items(value: Any) -> Any:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list | tuple) else ()


def _too_deep(what: str) -> ConfigError:
    return ConfigError(f"{what} is nested too deep; valid: up to {DEEPEST} levels")
