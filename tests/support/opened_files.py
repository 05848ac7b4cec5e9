"""How often a reader opens the files of a store."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from grasp_factory.core.place import Place
from grasp_factory.writers.zarr import chunks


def opened_shards(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Return a counter that each opening of a shard from now on is added to, by its path."""
    opened: Counter[str] = Counter()
    read = chunks.ShardFile.__init__

    def note(shard: Any, folder: Place, name: str, count: int) -> None:
        opened[str(folder / name)] += 1
        read(shard, folder, name, count)

    monkeypatch.setattr(chunks.ShardFile, "__init__", note)
    return opened
