"""The result of a merge or a split."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from grasp_factory.curation.merge.provenance import SeedSource


@dataclass(frozen=True, slots=True, kw_only=True)
class Collected:
    """A merged or split store. Every row was read back and compared."""

    path: str
    rows: int
    committed: int
    quarantined: int
    missing: int
    """Rows that no store had; only if the result is the dataset of one seed, which ``generate``
    can complete."""
    can_grow: bool
    """Whether row i is episode i of one seed, as if ``generate`` had made it."""
    repeated: int
    """Rows that were in more than one store, counted once for each store beyond the first."""
    sources: tuple[SeedSource, ...]
    labels: tuple[str, ...]
    """Added labels that were carried over."""
    labels_left_out: Mapping[str, str]
    """Added labels that were not carried over, and why."""
    annotations: int
    """Rows with annotations, which were carried over."""
    warnings: tuple[str, ...]
