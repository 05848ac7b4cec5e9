"""Streams at the times of one of them: values between their samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasp_factory.capture.sync.sync_settings import SyncSettings
from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError
from grasp_factory.signals.timeline import linear


@dataclass(frozen=True, slots=True, kw_only=True)
class Interpolated:
    """A stream at the times of the reference."""

    values: Array
    """(K, ...); NaN where the samples around an instant are too far apart."""
    matched: NDArray[np.bool_]
    """(K,)"""
    gaps: Array
    """(K,) seconds between the samples around each instant; 0 at a sample, NaN outside."""


def interpolate(
    streams: Mapping[str, tuple[ArrayLike, ArrayLike]], at: ArrayLike, settings: SyncSettings
) -> dict[str, Interpolated]:
    """Return streams at the times of the reference, by name.

    A value lies exactly at its instant. Its error is that of the clocks, and what the signal does
    between two samples; ``gaps`` says how far these are apart.

    Args:
        streams: Times (N,) in seconds, ascending, and values (N, ...) by name.
        at: (K,) the reference's times, seconds.
        settings: ``slop_s`` is the longest gap that is bridged.

    Raises:
        UsageError: for times that do not ascend.
    """
    found = {}
    for name, (stamps, values) in streams.items():
        times = np.asarray(stamps, np.float64)
        if len(times) != len(np.asarray(values)):
            raise UsageError(f"{name}: as many times as values are needed")
        gaps = gaps_around(times, at)
        aligned = linear(times, values, at)
        matched = aligned.matched & (gaps <= settings.slop_s)
        aligned.values[~matched] = np.nan
        found[name] = Interpolated(values=aligned.values, matched=matched, gaps=gaps)
    return found


def gaps_around(times: ArrayLike, at: ArrayLike) -> Array:
    """Return the distance of the samples around each instant, (K,) seconds; see ``gaps``."""
    times, at = np.asarray(times, np.float64), np.asarray(at, np.float64)
    if not len(times):
        return np.full(len(at), np.nan)
    after = np.searchsorted(times, at)
    inside = (at >= times[0]) & (at <= times[-1])
    after = np.clip(after, 0, len(times) - 1)
    before = np.maximum(after - 1, 0)
    gap = np.where(times[after] == at, 0.0, times[after] - times[before])
    return np.where(inside, gap, np.nan)
