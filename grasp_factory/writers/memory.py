"""A writer that keeps its blocks in memory, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grasp_factory.episode import Episode
from grasp_factory.writers.base import Quarantined, Writer, check_rows


class MemoryWriter(Writer):
    """Keeps blocks in a dictionary.

    Attributes:
        blocks: the rows of each written block, by the block's number.
    """

    def __init__(self, path: Path | None = None, *, block_size: int = 8) -> None:
        """Start empty; ``path`` is not touched (it is there to be built like the others)."""
        self.path = path
        self.block_size = block_size
        self.blocks: dict[int, tuple[Episode | Quarantined, ...]] = {}

    def write_block(self, block: int, rows: Sequence[Episode | Quarantined]) -> None:
        """Keep ``rows``; see ``Writer.write_block``."""
        check_rows(block, rows, block * self.block_size, self.block_size)
        self.blocks[block] = tuple(rows)
