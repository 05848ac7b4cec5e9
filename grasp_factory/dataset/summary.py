"""Counts of the episodes of a store."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any, TypeVar

from grasp_factory.dataset.annotations.listing import tag_counts
from grasp_factory.dataset.counts import (
    count_outcomes,
    count_platforms,
    count_scores,
    count_statuses,
)
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.joined_stores import JoinedColumns
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.sizes import store_bytes
from grasp_factory.writers.zarr.writer import COMMITTED

K = TypeVar("K", str, tuple[str, str])

_BALANCED = ("policy", "object_family")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """How many episodes of one kind there are, and how many of them succeeded."""

    episodes: int
    successes: int
    success_rate: float | None
    """None if there are no episodes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreSummary:
    """The episodes of a store, counted in several ways; rates are over committed episodes."""

    path: str
    """Of the store, or of the first of several, and their number."""
    episodes: int
    """Rows of the store."""
    committed: int
    quarantined: int
    missing: int
    successes: int
    success_rate: float | None
    policies: Mapping[str, Tally]
    outcomes: Mapping[str, int]
    """Only outcomes that occur, in the order of ``Outcome``."""
    families: Mapping[str, Tally]
    """By the target's kind of shape; empty for stores from before families were recorded."""
    families_by_policy: Mapping[str, Mapping[str, Tally]]
    """By family, then by policy; only those that occur."""
    object_sets: Mapping[str, Tally]
    splits: Mapping[str, Tally]
    quality: Mapping[str, int]
    """Episodes by score, the best first; empty for stores from before scores were recorded."""
    annotated: int
    """Rows that people have annotated."""
    corrected: int
    """Rows whose label people have corrected."""
    tags: Mapping[str, int]
    """How many rows have each tag, the most frequent first."""
    platforms: Mapping[str, int]
    """Rows by the fingerprint of the platform that made them; rows without one are left out."""
    bytes: int
    """Size of all files, except those that a killed run left of its last blocks."""
    bytes_per_episode: int | None


def summarise(dataset: Dataset) -> StoreSummary:
    """Return the counts of a dataset's episodes; those of several stores are added."""
    parts = [Columns.open(path) for path in dataset.paths]
    columns = JoinedColumns(parts, dataset.starts)
    newer = [name for name in ("quality", "object_family", "fingerprint") if name in columns.names]
    read = columns.read("status", "success", "outcome", "policy", "object_set", "split", *newer)
    status = read["status"]
    made = status == COMMITTED
    kept = {name: values[made] for name, values in read.items()}
    success: list[bool] = kept["success"].tolist()
    policy, family = (kept[name].tolist() if name in kept else [] for name in _BALANCED)
    total = _tally(len(success), sum(success))
    said = dataset.annotations.values()
    size, (missing, _, quarantined) = sum(map(store_bytes, parts)), count_statuses(status)
    return StoreSummary(
        path=dataset.name,
        episodes=len(dataset),
        committed=total.episodes,
        quarantined=quarantined,
        missing=missing,
        successes=total.successes,
        success_rate=total.success_rate,
        policies=_tallies(policy, success),
        outcomes=count_outcomes(kept["outcome"]),
        families=_tallies(family, success),
        families_by_policy=_nested(_tallies(list(zip(family, policy, strict=False)), success)),
        object_sets=_tallies(kept["object_set"].tolist(), success),
        splits=_tallies(kept["split"].tolist(), success),
        quality=count_scores(kept["quality"]) if "quality" in kept else {},
        annotated=len(said),
        corrected=sum(annotation.outcome is not None for annotation in said),
        tags=tag_counts(said),
        platforms=count_platforms(read["fingerprint"].tolist()) if "fingerprint" in read else {},
        bytes=size,
        bytes_per_episode=round(size / total.episodes) if total.episodes else None,
    )


def array_facts(dataset: Dataset) -> list[dict[str, Any]]:
    """Return path, shape, type and units of every array of a store, from its metadata."""
    return [
        {
            "path": path,
            "shape": list(array.shape),
            "dtype": "string" if array.dtype.kind == "T" else array.dtype.name,
            "units": array.attrs.asdict().get("units", ""),
        }
        for path, array in sorted(dataset.arrays().items())
    ]


def _tallies(keys: Sequence[K], success: Sequence[bool]) -> dict[K, Tally]:
    """Return a tally for each different key, sorted; ``keys`` has one item for each episode."""
    episodes, successes = Counter(keys), Counter(compress(keys, success))
    return {key: _tally(episodes[key], successes[key]) for key in sorted(episodes)}


def _nested(tallies: Mapping[tuple[str, str], Tally]) -> dict[str, dict[str, Tally]]:
    out: dict[str, dict[str, Tally]] = {}
    for (first, second), tally in tallies.items():
        out.setdefault(first, {})[second] = tally
    return out


def _tally(episodes: int, successes: int) -> Tally:
    rate = round(successes / episodes, 4) if episodes else None
    return Tally(episodes=episodes, successes=successes, success_rate=rate)
