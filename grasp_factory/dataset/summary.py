"""What is in a store, counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.platforms import parsed
from grasp_factory.dataset.annotations.listing import tag_counts
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.zarr.columns import Columns
from grasp_factory.writers.zarr.sizes import store_bytes
from grasp_factory.writers.zarr.writer import COMMITTED, MISSING, QUARANTINED

K = TypeVar("K", str, tuple[str, str])

_BALANCED = ("policy", "object_family")


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
    families: Mapping[str, Tally]
    """By the target's kind of shape; none for stores from before there were."""
    families_by_policy: Mapping[str, Mapping[str, Tally]]
    """By family, then by policy; only those that occur."""
    object_sets: Mapping[str, Tally]
    splits: Mapping[str, Tally]
    quality: Mapping[str, int]
    """How many episodes have each score, the best first; none for stores from before there were."""
    annotated: int
    """Rows of which people have said something."""
    corrected: int
    """Rows whose label people have corrected."""
    tags: Mapping[str, int]
    """How many rows have each tag, the most frequent first."""
    platforms: Mapping[str, int]
    """Rows by the fingerprint of the platform that made them; those that tell none are left out."""
    bytes: int
    """Of all files, but what a run that was killed has left of its last blocks."""
    bytes_per_episode: int | None


def summarise(dataset: Dataset) -> StoreSummary:
    """Count what a dataset holds."""
    columns = Columns.open(dataset.path)
    newer = [name for name in ("quality", "object_family", "fingerprint") if name in columns.names]
    read = columns.read("status", "success", "outcome", "policy", "object_set", "split", *newer)
    status = read["status"]
    made = status == COMMITTED
    kept = {name: values[made] for name, values in read.items()}
    success: list[bool] = kept["success"].tolist()
    policy, family = (kept[name].tolist() if name in kept else [] for name in _BALANCED)
    outcomes = np.bincount(kept["outcome"], minlength=len(Outcome))
    total = _tally(len(success), sum(success))
    said = dataset.annotations.values()
    size = store_bytes(columns)
    return StoreSummary(
        path=str(dataset.path),
        episodes=len(dataset),
        committed=total.episodes,
        quarantined=int(np.sum(status == QUARANTINED)),
        missing=int(np.sum(status == MISSING)),
        successes=total.successes,
        success_rate=total.success_rate,
        policies=_tallies(policy, success),
        outcomes={
            word: int(count) for word, count in zip(names(Outcome), outcomes, strict=True) if count
        },
        families=_tallies(family, success),
        families_by_policy=_nested(_tallies(list(zip(family, policy, strict=False)), success)),
        object_sets=_tallies(kept["object_set"].tolist(), success),
        splits=_tallies(kept["split"].tolist(), success),
        quality=_scores(kept["quality"]) if "quality" in kept else {},
        annotated=len(said),
        corrected=sum(annotation.outcome is not None for annotation in said),
        tags=tag_counts(said),
        platforms=platforms_of(read["fingerprint"].tolist()) if "fingerprint" in read else {},
        bytes=size,
        bytes_per_episode=round(size / total.episodes) if total.episodes else None,
    )


def platforms_of(texts: Iterable[str]) -> dict[str, int]:
    """Return how many of these texts of rows tell each fingerprint, the most frequent first."""
    told = {str(found): n for text, n in Counter(texts).items() if (found := parsed(text))}
    return dict(sorted(told.items(), key=lambda item: (-item[1], item[0])))


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


def _tallies(keys: Sequence[K], success: Sequence[bool]) -> dict[K, Tally]:
    """Return a tally for each key among those of all episodes, in the keys' order."""
    episodes, successes = Counter(keys), Counter(compress(keys, success))
    return {key: _tally(episodes[key], successes[key]) for key in sorted(episodes)}


def _nested(tallies: Mapping[tuple[str, str], Tally]) -> dict[str, dict[str, Tally]]:
    out: dict[str, dict[str, Tally]] = {}
    for (first, second), tally in tallies.items():
        out.setdefault(first, {})[second] = tally
    return out


def _scores(quality: NDArray[np.uint8]) -> dict[str, int]:
    scores, episodes = np.unique(quality, return_counts=True)
    return {str(s): int(n) for s, n in zip(scores[::-1], episodes[::-1], strict=True)}


def _tally(episodes: int, successes: int) -> Tally:
    rate = round(successes / episodes, 4) if episodes else None
    return Tally(episodes=episodes, successes=successes, success_rate=rate)
