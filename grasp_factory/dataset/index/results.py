"""What an index answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexedStore:
    """A store of an index, with the rows that it had when the index last looked."""

    id: int
    """Its number in the index, from 0."""
    path: Path
    name: str
    rows: int
    """Committed and quarantined."""
    committed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Some of the rows that a query finds."""

    total: int
    """How many it finds."""
    rows: list[dict[str, Any]]
    """By column; ``tags`` is a list, ``sensor_setup`` a mapping."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbours:
    """A row's place among those that a query finds."""

    position: int | None
    """From 0; None if it is not among them."""
    total: int
    previous: tuple[int, int] | None
    """Store and row."""
    next: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class WordBars:
    """How often each value of a column comes."""

    column: str
    bars: list[tuple[str | None, int, int]]
    """Value (None: no value), episodes, successes; the most frequent first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberBins:
    """How often a column's values lie between edges; the last bin has its upper edge too."""

    column: str
    units: str
    edges: list[float]
    """One more than bins; none without values."""
    counts: list[int]
    successes: list[int]
    missing: int
    """Rows without a value."""
