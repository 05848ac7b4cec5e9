"""The index of stores: an SQLite file that is derived from them, and what can be asked of it."""

from __future__ import annotations

from grasp_factory.dataset.index.building import Built, build, default_path
from grasp_factory.dataset.index.columns import COLUMNS, IndexColumn
from grasp_factory.dataset.index.handle import Index
from grasp_factory.dataset.index.meaning import check_found
from grasp_factory.dataset.index.opening import fresh
from grasp_factory.dataset.index.query import OPERATORS, SYNTAX, Condition, Query, Sort
from grasp_factory.dataset.index.results import IndexedStore, Neighbours, NumberBins, Page, WordBars

__all__ = [
    "COLUMNS",
    "OPERATORS",
    "SYNTAX",
    "Built",
    "Condition",
    "Index",
    "IndexColumn",
    "IndexedStore",
    "Neighbours",
    "NumberBins",
    "Page",
    "Query",
    "Sort",
    "WordBars",
    "build",
    "check_found",
    "default_path",
    "fresh",
]
