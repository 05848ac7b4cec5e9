"""Attacks: what a hostile store, or something that lies beside it, could contain.

Each attack changes a copy of an honest store, or what lies beside it. A module of this package has
those of one kind.
"""

from __future__ import annotations

from support.hostile import (
    carried,
    links,
    logs,
    metadata,
    names,
    packed,
    recipes,
    sizes,
    texts,
    values,
    volumes,
)
from support.hostile.table import ATTACKS, victim

KINDS = (*(links, sizes, packed, names, metadata, values, recipes, carried, logs, texts, volumes),)
"""The modules, which add to ``ATTACKS`` as they are imported."""

__all__ = ["ATTACKS", "KINDS", "victim"]
