"""Blocks of episodes to make, and what a worker tells of them: records alone, no simulator."""

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
    """Episodes of it that are not tried any more, and why; they are quarantined."""
    retries: bool = False
    """Episodes that are in quarantine already are tried again."""

    def __str__(self) -> str:
        return f"block {self.block}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun:
    """An episode is about to be made."""

    index: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Made:
    """One episode, in few words: what travels from a worker instead of its images."""

    index: int
    policy: str
    outcome: str
    """``quarantined`` for a recipe that gave no episode."""
    reason: str = ""
    """Why it is quarantined."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Committed:
    """A block is in the store, for good."""

    block: int


def block_range(block: int, block_size: int, length: int) -> range:
    """Return the episodes of a block in a store of ``length`` rows."""
    return range(block * block_size, min((block + 1) * block_size, length))


def shard_rows(request: Request) -> NDArray[np.int64]:
    """Return the rows of a request's part of its store, ascending."""
    rows = np.arange(request.n)
    return np.asarray(rows[request.shard.has(rows // request.config.block_size)])


def in_few_words(row: Episode | Quarantined, index: int) -> Made:
    """Return what is told of a row that was made."""
    more: dict[str, Any] = {"index": index, "policy": row.spec.policy}
    if isinstance(row, Quarantined):
        return Made(outcome="quarantined", reason=row.reason, **more)
    return Made(outcome=row.outcome.name.lower(), **more)
