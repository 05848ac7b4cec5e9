"""Merging and splitting: a new store from rows of existing stores."""

from __future__ import annotations

from grasp_factory.curation.merge.merging import merge
from grasp_factory.curation.merge.result import Collected
from grasp_factory.curation.merge.splitting import split

__all__ = ["Collected", "merge", "split"]
