"""Small things that several tests need."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.store import missing_rows


def tree(root: Path) -> dict[str, bytes]:
    """Return every file below ``root`` with its bytes."""
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def assert_same_tree(a: Path, b: Path) -> None:
    """Fail, naming the files, unless two trees hold the same files with the same bytes."""
    left, right = tree(a), tree(b)
    assert sorted(left) == sorted(right)
    differ = [name for name in left if left[name] != right[name]]
    assert differ == []


def pending_blocks(path: Path, n: int) -> list[int]:
    """Return the blocks in which any of the first ``n`` episodes is missing."""
    missing, size = missing_rows(path), Columns.open(path).config.block_size
    return [int(block) for block in np.unique(missing[missing < n] // size)]
