"""What is in a store, counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset import Dataset
from grasp_factory.outcome import Outcome, names
from grasp_factory.writers.columns import Columns
from grasp_factory.writers.sizes import store_bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Tally:
    """How often an attempt of one kind succeeded."""

    episodes: int
    successes: int
    success_rate: float | None
    """None without episodes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreSummary:
    """The episodes of a store, counted in several ways. Rates are over the committed ones."""

    path: str
    episodes: int
    """Rows of the store."""
    committed: int
    quarantined: int
    missing: int
    successes: int
    success_rate: float | None
    policies: Mapping[str, Tally]
    outcomes: Mapping[str, int]
    """Only those that occur, in their fixed order."""
    object_sets: Mapping[str, Tally]
    splits: Mapping[str, Tally]
    quality: Mapping[str, int]
    """How many episodes have each score, the best first; none for stores from before there were."""
    bytes: int
    """Of all files, but what a run that was killed has left of its last blocks."""
    bytes_per_episode: int | None


def summarise(dataset: Dataset) -> StoreSummary:
    """Count what a dataset holds."""
    columns = Columns.open(dataset.path)
    scored = ("quality",) if "quality" in columns.names else ()
    read = columns.read("status", "success", "outcome", "policy", "object_set", "split", *scored)
    status = read["status"]
    made = status == 1
    success = read["success"][made]
    outcomes = np.bincount(read["outcome"][made], minlength=len(Outcome))
    total = _tally(success)
    size = store_bytes(columns)
    return StoreSummary(
        path=str(dataset.path),
        episodes=len(dataset),
        committed=total.episodes,
        quarantined=int(np.sum(status == 2)),
        missing=int(np.sum(status == 0)),
        successes=total.successes,
        success_rate=total.success_rate,
        policies=_tallies(read["policy"][made], success),
        outcomes={
            word: int(count) for word, count in zip(names(Outcome), outcomes, strict=True) if count
        },
        object_sets=_tallies(read["object_set"][made], success),
        splits=_tallies(read["split"][made], success),
        quality=_scores(read["quality"][made]) if scored else {},
        bytes=size,
        bytes_per_episode=round(size / total.episodes) if total.episodes else None,
    )


def array_facts(dataset: Dataset) -> list[dict[str, Any]]:
    """Return path, shape, type and units of every array of a store, as its metadata says."""
    return [
        {
            "path": path,
            "shape": list(array.shape),
            "dtype": "string" if array.dtype.kind == "T" else array.dtype.name,
            "units": array.attrs.asdict().get("units", ""),
        }
        for path, array in sorted(dataset.arrays().items())
    ]


def _tallies(keys: NDArray[np.str_], success: NDArray[np.bool_]) -> dict[str, Tally]:
    words = sorted(set(keys.tolist()))
    return {word: _tally(success[keys == word]) for word in words}


def _scores(quality: NDArray[np.uint8]) -> dict[str, int]:
    scores, episodes = np.unique(quality, return_counts=True)
    return {str(s): int(n) for s, n in zip(scores[::-1], episodes[::-1], strict=True)}


def _tally(success: NDArray[np.bool_]) -> Tally:
    episodes, successes = len(success), int(success.sum())
    rate = round(successes / episodes, 4) if episodes else None
    return Tally(episodes=episodes, successes=successes, success_rate=rate)
