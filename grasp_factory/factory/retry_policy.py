"""When a worker dies, its episode is tried once more; when too many episodes fail, a run stops."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from grasp_factory.core.executors import LostNode
from grasp_factory.errors import FailuresError, WorkerError
from grasp_factory.factory.block_job import Begun, BlockJob, Committed, Made

TRIES_OF_EPISODE = 2
"""Number of tries of an episode. One is not enough: a killed worker, or full memory, would then
decide what is in the dataset."""
TRIES_OF_BLOCK = 3
"""Number of tries of a block whose worker died while it was making no episode."""
SLOWEST_WRITE_S = 600.0
"""Seconds after which a worker that starts, or writes a block, counts as stuck."""
FEWEST_FAILURES = 20
"""A run is not stopped for its failures unless there are more than this many."""


@dataclass(slots=True)
class _InHand:
    """Progress of a block that is not committed yet."""

    index: int | None = None
    """The episode that is being made."""
    told: int = -1
    """The last episode that was reported."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a worker may be silent; it is sent to the nodes of a cluster."""

    timeout: float
    """Seconds that an episode may take."""

    def __call__(self, message: Any) -> float:
        """Return how long a worker may be silent after a message; see ``executors.Silence``."""
        if isinstance(message, Begun):
            return self.timeout
        return max(SLOWEST_WRITE_S, self.timeout) if self.timeout < math.inf else math.inf


class Losses:
    """Follows the workers' reports, and decides what to do when a worker or a node is lost.

    Attributes:
        silence: how long a worker may be silent.
    """

    def __init__(self, block_size: int, timeout: float, on_loss: Callable[[str], None]) -> None:
        """Start without any report.

        Args:
            block_size: episodes of a block.
            timeout: seconds that an episode may take.
            on_loss: called with one line of text for each loss.
        """
        self._block_size, self._on_loss = block_size, on_loss
        self.silence = Patience(timeout)
        self._in_hand: dict[int, _InHand] = {}
        self._deaths: Counter[str] = Counter()

    def news(self, message: Begun | Made | Committed) -> Made | None:
        """Process a message; return it if it reports an episode for the first time."""
        if isinstance(message, Committed):
            self._in_hand.pop(message.block, None)
            return None
        block = self._in_hand.setdefault(message.index // self._block_size, _InHand())
        if isinstance(message, Begun):
            block.index = message.index
            return None
        block.index = None
        if message.index <= block.told:
            return None
        block.told = message.index
        return message

    def recover(self, job: BlockJob, why: str) -> BlockJob:
        """Return the job that replaces one whose worker was lost; see ``executors.Recover``.

        If the worker's node was lost, no episode is to blame.

        Raises:
            WorkerError: if a block's workers are lost repeatedly, and no episode is to blame.
        """
        block = self._in_hand.setdefault(job.block, _InHand())
        index, block.index = block.index, None
        is_blamed = index is not None and index not in job.lost and not isinstance(why, LostNode)
        blamed = f"episode {index}" if is_blamed else str(job)
        self._deaths[blamed] += 1
        times = self._deaths[blamed]
        if blamed == str(job):
            if times == TRIES_OF_BLOCK:
                raise WorkerError(
                    f"{times} workers were lost in {job} ({why}); the blocks that are committed"
                    " stay: run the same command again to go on"
                )
        elif times == TRIES_OF_EPISODE:
            assert index is not None
            return replace(job, lost={**job.lost, index: f"its worker was lost twice ({why})"})
        self._on_loss(f"a worker was lost in {blamed} ({why}); the block is made again")
        return job


class Failures:
    """Counts quarantined episodes, and stops a run that has too many of them."""

    def __init__(self, max_failures: float, to_make: int) -> None:
        """Allow a share of the episodes to make."""
        self._allowed = max(max_failures * to_make, FEWEST_FAILURES)
        self._count = 0

    def count(self, made: Made) -> None:
        """Count an episode.

        Raises:
            FailuresError: if too many episodes are quarantined.
        """
        self._count += made.outcome == "quarantined"
        if self._count > self._allowed:
            raise FailuresError(
                f"{self._count} episodes of this run are quarantined, more than --max-failures"
                f" allows; the last one, {made.index}: {made.reason}; what is committed stays"
            )
