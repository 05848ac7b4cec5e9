"""How far apart the samples of a set are: for every set and every pair of streams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.capture.sync.sync_settings import SyncSettings, pair_name
from grasp_factory.core.geometry import Array
from grasp_factory.signals.sample_sets import TimeSets, approximate_time


@dataclass(frozen=True, slots=True, kw_only=True)
class PairSpread:
    """The distance in time of two streams' samples in the same sets."""

    name: str
    """Both streams, as in ``camera-imu``."""
    sets: int
    median_ms: float
    p95_ms: float
    largest_ms: float
    tolerance_ms: float | None
    """What the settings allow; None for no bound."""
    beyond: int
    """Sets beyond the tolerance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncResult:
    """Sets of samples that belong together, and how well."""

    sets: TimeSets
    differences: Mapping[str, Array]
    """(S,) by pair: time of the second stream's sample minus the first's, seconds."""
    spreads: tuple[PairSpread, ...]

    @property
    def missed(self) -> tuple[PairSpread, ...]:
        """The pairs with sets beyond their tolerance."""
        return tuple(spread for spread in self.spreads if spread.beyond)


def synchronise(streams: Mapping[str, ArrayLike], settings: SyncSettings) -> SyncResult:
    """Return the sets of samples that belong together.

    Args:
        streams: Times (N,) by name, seconds, ascending: when the samples were taken, on one clock.
        settings: slop and tolerances.

    Raises:
        UsageError: for times that do not ascend.
        ConfigError: for a tolerance of streams that are not there.
    """
    settings.check_streams(streams)
    sets = approximate_time(streams, settings.slop_s)
    times = {n: np.asarray(t, np.float64)[sets.indices[n]] for n, t in streams.items()}
    differences = {pair_name(a, b): times[b] - times[a] for a, b in combinations(streams, 2)}
    spreads = tuple(
        _spread(name, values, settings.tolerance_of(name)) for name, values in differences.items()
    )
    return SyncResult(sets=sets, differences=differences, spreads=spreads)


def _spread(name: str, differences: Array, tolerance: float | None) -> PairSpread:
    distance = np.abs(differences)
    some = distance if len(distance) else np.array([np.nan])
    return PairSpread(
        name=name,
        sets=len(distance),
        median_ms=float(np.median(some)) * 1e3,
        p95_ms=float(np.percentile(some, 95.0)) * 1e3,
        largest_ms=float(some.max()) * 1e3,
        tolerance_ms=None if tolerance is None else tolerance * 1e3,
        beyond=0 if tolerance is None else int((distance > tolerance).sum()),
    )
