"""The results of queries of an index."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexedStore:
    """A store of an index, with its numbers of rows when the index was last updated."""

    id: int
    """Its number in the index, from 0."""
    path: Path
    name: str
    rows: int
    """Number of committed and quarantined rows."""
    committed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Some of the rows that a query finds."""

    total: int
    """Number of rows that the query finds."""
    rows: list[dict[str, Any]]
    """Values by column, for each row; ``tags`` is a list, ``sensor_setup`` a mapping."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Neighbours:
    """A row's position among the rows that a query finds."""

    position: int | None
    """From 0; None if the row is not among them."""
    total: int
    previous: tuple[int, int] | None
    """Store and row."""
    next: tuple[int, int] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class WordBars:
    """How often each value of a column occurs."""

    column: str
    bars: list[tuple[str | None, int, int]]
    """Value (None: no value), episodes, successes; the most frequent first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberBins:
    """How many of a column's values are in each bin; the last bin includes its upper edge."""

    column: str
    units: str
    edges: list[float]
    """One more than the number of bins; empty if there are no values."""
    counts: list[int]
    successes: list[int]
    missing: int
    """Rows without a value."""
