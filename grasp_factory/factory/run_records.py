"""The records of a run: what it is about to do, and what it did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.dataset.summary import StoreSummary
from grasp_factory.factory.run_request import Shard


@dataclass(frozen=True, slots=True, kw_only=True)
class RunPlan:
    """What a run is about to do."""

    path: Path
    config: FactoryConfig
    episodes: int
    """Rows of the store."""
    to_make: int
    """Episodes that are not there yet, of all blocks that this run touches."""
    already_there: int
    """Of the episodes asked for."""
    blocks: tuple[int, ...]
    workers: int
    shard: Shard


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a run did, and what the store holds now."""

    asked: int
    """Episodes of the run's part of the store."""
    made: int
    already_there: int
    """Of those asked for."""
    seconds: float
    episodes_per_second: float | None
    """None when nothing was to be made."""
    quarantined: Mapping[int, str]
    """Episodes asked for that are quarantined, and why."""
    failed: bool
    """Whether more episodes are quarantined than ``max_failures`` allows."""
    store: StoreSummary
