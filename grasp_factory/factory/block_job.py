"""Records of blocks to make and of a worker's reports about them; no simulator is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.factory.run_request import Request
from grasp_factory.writers.base import Quarantined

LONGEST_REASON = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class BlockJob:
    """A block to make."""

    block: int
    lost: Mapping[int, str] = field(default_factory=dict)
    """Episodes of the block that are not tried again, and why; they are quarantined."""
    retries: bool = False
    """Whether episodes that are already in quarantine are tried again."""

    def __str__(self) -> str:
        return f"block {self.block}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """An episode is about to be made."""

    index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """A summary of one episode, which a worker sends instead of the episode's images."""

    index: int
    policy: str
    outcome: str
    """``quarantined`` for a recipe that yielded no episode."""
    reason: str = ""
    """Why it is quarantined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Committed:
    """A block was committed to the store."""

    block: int


def block_range(block: int, block_size: int, length: int) -> range:
    """Return the episodes of a block in a store of ``length`` rows."""
    return range(block * block_size, min((block + 1) * block_size, length))


def shard_rows(request: Request) -> NDArray[np.int64]:
    """Return the rows of a request's part of its store, ascending."""
    rows = np.arange(request.n)
    size = request.shard.together or request.config.block_size
    return np.asarray(rows[request.shard.has(rows // size)])


def summary_of(row: Episode | Quarantined, index: int) -> Made:
    """Return the summary of a row that was made."""
    more: dict[str, Any] = {"index": index, "policy": row.spec.policy}
    if isinstance(row, Quarantined):
        return Made(outcome="quarantined", reason=row.reason, **more)
    return Made(outcome=row.outcome.name.lower(), **more)
