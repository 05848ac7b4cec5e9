"""Counts of a store's rows: by status, outcome, quality score and platform."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome, names
from grasp_factory.core.platforms import parsed
from grasp_factory.writers.zarr.writer import COMMITTED, MISSING, QUARANTINED


def count_statuses(status: NDArray[np.uint8]) -> tuple[int, int, int]:
    """Return how many rows are missing, committed and quarantined, from their statuses (N,)."""
    missing, committed, quarantined = (
        int(np.sum(status == one)) for one in (MISSING, COMMITTED, QUARANTINED)
    )
    return missing, committed, quarantined


def count_outcomes(outcome: NDArray[np.uint8]) -> dict[str, int]:
    """Return how many episodes have each outcome that occurs, in the order of ``Outcome``.

    Unknown codes are left out.
    """
    counts = np.bincount(outcome, minlength=len(Outcome))
    return {word: int(n) for word, n in zip(names(Outcome), counts, strict=False) if n}


def count_scores(quality: NDArray[np.uint8]) -> dict[str, int]:
    """Return how many episodes have each quality score that occurs, the best first."""
    scores, episodes = np.unique(quality, return_counts=True)
    return {str(s): int(n) for s, n in zip(scores[::-1], episodes[::-1], strict=True)}


def count_platforms(texts: Iterable[str]) -> dict[str, int]:
    """Return how many rows have each valid fingerprint, the most frequent first."""
    known = {str(found): n for text, n in Counter(texts).items() if (found := parsed(text))}
    return most_frequent_first(known)


def most_frequent_first(counts: Mapping[str, int]) -> dict[str, int]:
    """Return counts in descending order; equal counts are ordered by name."""
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))
