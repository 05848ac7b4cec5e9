"""A block whose episodes are replaced by others, which the writer itself refuses to do."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grasp_factory.core.episode import Episode
from grasp_factory.core.schema import STATUS
from grasp_factory.writers.base import Quarantined
from grasp_factory.writers.zarr.writer import ZarrWriter


def replace_block(
    path: Path, block: int, rows: Sequence[Episode | Quarantined], fingerprints: Sequence[str] = ()
) -> None:
    """Write rows in place of those of a block, which is no longer committed meanwhile."""
    (path / STATUS.path / str(block)).unlink()
    ZarrWriter(path).write_block(block, rows, fingerprints)
