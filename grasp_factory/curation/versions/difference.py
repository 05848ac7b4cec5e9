"""The result of a comparison of two versions of a store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

RowNames = NDArray[np.int64]
"""(K, 3): the number in its store, the recipe's seed and the recipe's index of each row."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """What two versions A and B do not have in common."""

    a: str
    b: str
    """Names of the versions."""
    added: RowNames
    """RowNames that only B has, with their numbers in B."""
    removed: RowNames
    """RowNames that only A has, with their numbers in A."""
    changed: RowNames
    """RowNames that both have, with another content or status, and their numbers in B."""
    unchanged: int
    arrays: Mapping[str, int] | None
    """By path: in how many changed rows that are committed in both versions an array is another
    one; None if this was not compared."""
    settings: tuple[str, ...]
    """Root attributes that differ: ``key: a's value against b's``."""
    labels: Mapping[str, str]
    """Added labels that differ: added, removed or changed."""
    annotations: str
    """What happened to the annotation log: added, removed, grown, changed; empty for nothing."""

    @property
    def is_empty(self) -> bool:
        """Whether the versions are the same."""
        rows = len(self.added) + len(self.removed) + len(self.changed)
        return not (rows or self.settings or self.labels or self.annotations)

    def rows(self) -> Iterator[tuple[str, int, int, int]]:
        """Yield word, number, seed and index of each row that was added, removed or changed."""
        for word in ("added", "removed", "changed"):
            for row, seed, index in getattr(self, word).tolist():
                yield word, row, seed, index

    def to_plain(self, *, ids: bool) -> dict[str, Any]:
        """Return plain data; rows are counted, and with ``ids`` also listed."""
        plain: dict[str, Any] = {"a": self.a, "b": self.b, "is_empty": self.is_empty}
        for word in ("added", "removed", "changed"):
            plain[word] = len(getattr(self, word))
        plain["unchanged"] = self.unchanged
        if self.arrays is not None:
            plain["arrays"] = dict(self.arrays)
        plain |= {
            "settings": list(self.settings),
            "labels": dict(self.labels),
            "annotations": self.annotations,
        }
        if ids:
            keys = ("what", "row", "seed", "index")
            plain["rows"] = [dict(zip(keys, row, strict=True)) for row in self.rows()]
        return plain
