"""A writer that keeps its blocks in memory, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grasp_factory.core.episode import Episode
from grasp_factory.writers.base import Quarantined, Writer, check_rows, texts_of


class MemoryWriter(Writer):
    """Keeps blocks in a dictionary.

    Attributes:
        blocks: the rows of each written block, by the block's number.
        fingerprints: the texts of their platforms, in the same way.
    """

    def __init__(self, path: Path | None = None, *, block_size: int = 8) -> None:
        """Start empty; ``path`` is not used (all writers take one)."""
        self.path = path
        self.block_size = block_size
        self.blocks: dict[int, tuple[Episode | Quarantined, ...]] = {}
        self.fingerprints: dict[int, tuple[str, ...]] = {}

    def write_block(
        self,
        block: int,
        rows: Sequence[Episode | Quarantined],
        fingerprints: Sequence[str] = (),
    ) -> None:
        """Keep ``rows``; see ``Writer.write_block``."""
        check_rows(block, rows, block * self.block_size, self.block_size)
        self.blocks[block] = tuple(rows)
        self.fingerprints[block] = texts_of(rows, fingerprints)
