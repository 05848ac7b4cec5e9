"""What every writer does: take a block of consecutive episodes and keep it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from grasp_factory.episode import Episode, EpisodeSpec
from grasp_factory.errors import StoreError


@dataclass(frozen=True, slots=True)
class Quarantined:
    """An episode that could not be made: its recipe and why, in place of its data."""

    spec: EpisodeSpec
    reason: str
    """One line, the same for the same recipe: it is part of the dataset's bytes."""


class Writer(ABC):
    """Takes finished blocks. One instance per process; a block has one owner at a time."""

    @abstractmethod
    def write_block(self, block: int, rows: Sequence[Episode | Quarantined]) -> None:
        """Replace block ``block`` by these rows, all of them or none.

        Args:
            block: number of the block; its first episode is ``block * block_size``.
            rows: consecutive episodes from the block's first one on.

        Raises:
            StoreError: if the rows are not that, or do not fit what the writer holds.
        """


def check_rows(block: int, rows: Sequence[Episode | Quarantined], first: int, most: int) -> None:
    """Check that ``rows`` are 1 to ``most`` consecutive episodes, starting with ``first``.

    Raises:
        StoreError: naming the block, the indices it got and the valid ones.
    """
    got = [row.spec.index for row in rows]
    if not got or got != list(range(first, first + min(len(got), most))):
        valid = f"1 to {most} consecutive episodes from {first} on"
        raise StoreError(f"block {block}: got episodes {got}, valid: {valid}")
