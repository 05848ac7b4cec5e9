"""Collecting: rows of existing stores, put together into a new one or picked out of one."""

from __future__ import annotations

from grasp_factory.collecting.merging import merge
from grasp_factory.collecting.result import Collected
from grasp_factory.collecting.splitting import split

__all__ = ["Collected", "merge", "split"]
