"""The index of stores: an SQLite file that is derived from them, and what can be asked of it."""

from __future__ import annotations

from grasp_factory.index.building import Built, build, default_path
from grasp_factory.index.columns import COLUMNS, Column
from grasp_factory.index.handle import Index
from grasp_factory.index.opening import fresh
from grasp_factory.index.query import OPERATORS, SYNTAX, Condition, Query, Sort
from grasp_factory.index.results import IndexedStore, Neighbours, NumberBins, Page, WordBars

__all__ = [
    "COLUMNS",
    "OPERATORS",
    "SYNTAX",
    "Built",
    "Column",
    "Condition",
    "Index",
    "IndexedStore",
    "Neighbours",
    "NumberBins",
    "Page",
    "Query",
    "Sort",
    "WordBars",
    "build",
    "default_path",
    "fresh",
]
