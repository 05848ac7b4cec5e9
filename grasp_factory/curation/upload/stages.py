"""The stages and blocks of a store that is made for object storage: sizes, and rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.errors import ConfigError
from grasp_factory.factory.block_job import shard_rows
from grasp_factory.factory.run_request import MAX_SHARDS, Request, Shard
from grasp_factory.writers.zarr.budgets import check_block_size

LARGEST = 512
"""Most episodes of a block in object storage, where each object costs a request."""
BLOCKS_OF_A_PART = 4
"""Least blocks of each part of a store, so that none has a quarter more than another."""
MADE_BY = 8
"""Episodes of a block while it is made, if that divides the store's own size."""
STAGE = 8192
"""Least episodes of a stage: a part of twice as many or more is made and sent in several."""


def stages_of(request: Request, larger: int) -> list[Request]:
    """Divide a request's part into parts of at least ``STAGE`` episodes, if it is larger.

    Each is a part of the whole store by itself: every k-th of every ``count``-th block.
    """
    shard, rows = request.shard, len(rows_of(request, larger))
    k = min(rows // STAGE, MAX_SHARDS // shard.count)
    if k <= 1:
        return [request]
    count, first = k * shard.count, shard.index % shard.count
    stages = [replace(request, shard=Shard(i, count)) for i in range(first, count, shard.count)]
    return [stage for stage in stages if len(rows_of(stage, larger))]


def config_here(request: Request) -> FactoryConfig:
    """Return the config with which episodes are made here, to be joined to larger blocks."""
    size = request.config.block_size
    return replace(request.config, block_size=size if size % MADE_BY else MADE_BY)


def joined(request: Request, block_size: int) -> Shard:
    """Return a request's part, whose blocks will be joined to those of a size."""
    return replace(request.shard, together=block_size if request.shard.count > 1 else 0)


def rows_of(request: Request, block_size: int) -> NDArray[np.int64]:
    """Return the rows of a request's part, in a store with blocks of a size."""
    return shard_rows(replace(request, shard=joined(request, block_size)))


def largest_block(request: Request) -> int:
    """Return the largest size of blocks, up to ``LARGEST``, that readers accept.

    With several parts, there must be blocks enough for parts of nearly the same size.
    """
    config, parts = config_here(request), request.shard.count
    size, most = config.block_size, LARGEST
    if parts > 1:
        most = request.n // (BLOCKS_OF_A_PART * parts)
    while size * 2 <= min(LARGEST, most):
        try:
            check_block_size(replace(config, block_size=size * 2))
        except ConfigError:
            break
        size *= 2
    return size
