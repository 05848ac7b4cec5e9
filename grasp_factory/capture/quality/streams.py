"""Measures of one stream: rate, longest gap, lost samples, samples at the end of the range."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.geometry import Array
from grasp_factory.signals.timeline import Ticks

_AT_END = 0.999
"""Share of the full scale from which a sample counts as saturated."""
_RUN = 3
"""Samples in a row with the same extreme value, from which they count as saturated."""
_STEPS = 16
"""Smallest steps between the median and an extreme value, below which it is noise."""
_NS = 1e-9


def measured_rate(times_ns: Ticks, sequence: Ticks | None) -> float:
    """Return the rate at which samples are made, in Hz; NaN for fewer than two instants.

    Args:
        times_ns: (N,) of the samples.
        sequence: (N,) the device's count, unwrapped, so that lost samples count as well; None if
            it does not count.
    """
    span = float(np.ptp(times_ns)) * _NS if len(times_ns) else 0.0
    made = len(times_ns) - 1 if sequence is None else int(np.ptp(sequence))
    return made / span if span > 0.0 and made > 0 else math.nan


def longest_gap(times_ns: Ticks, rate: float) -> float:
    """Return the longest time between two samples, in periods; NaN for fewer than two.

    Infinite if the times go back: then they say nothing about gaps.
    """
    steps = np.diff(times_ns)
    if not len(steps):
        return math.nan
    return math.inf if (steps < 0).any() else float(steps.max()) * _NS * rate


def lost_share(times_ns: Ticks, sequence: Ticks | None, rate: float | None) -> float:
    """Return the share of the samples that were made and are not there.

    The device's own count tells; without it, the time and the rate that it should have. NaN if
    neither is known.

    Args:
        times_ns: (N,) of the samples.
        sequence: (N,) the device's count, unwrapped; None if it does not count.
        rate: Hz that the device should have; None if unknown.
    """
    count = len(times_ns)
    if count < 2:
        return math.nan
    if sequence is not None:
        expected = int(sequence.max() - sequence.min()) + 1
        return max(0.0, 1.0 - len(np.unique(sequence)) / expected)
    if rate is None:
        return math.nan
    return max(0.0, 1.0 - count / (round(float(np.ptp(times_ns)) * _NS * rate) + 1))


def saturated_share(values: Array, full_scale: Array | None = None) -> float:
    """Return the share of samples of which any component is at the end of its range.

    Without a full scale, an extreme value that a component keeps for three samples or more is the
    end of its range, if it is far from the median: more than 16 of the smallest steps that the
    component makes. NaN without samples.

    Args:
        values: (N, C).
        full_scale: (C,) in the same unit.
    """
    if not len(values):
        return math.nan
    if full_scale is not None:
        at_end = np.abs(values) >= _AT_END * np.asarray(full_scale, np.float64)
    else:
        at_end = np.stack([_flat_ends(column) for column in values.T], axis=1)
    return float(at_end.any(axis=1).mean())


def _flat_ends(values: Array) -> NDArray[np.bool_]:
    """Return which samples (N,) are in a run at the greatest or least value."""
    out = np.zeros(len(values), np.bool_)
    steps = np.diff(np.unique(values[np.isfinite(values)]))
    if not len(steps):
        return out
    middle = float(np.median(values))
    for end in (np.nanmin(values), np.nanmax(values)):
        if abs(end - middle) > _STEPS * float(steps.min()):
            out |= _in_runs(values == end)
    return out


def _in_runs(marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the marks that belong to at least ``_RUN`` in a row."""
    edges = np.flatnonzero(np.diff(marked.astype(np.int8), prepend=0, append=0))
    out = np.zeros(len(marked), np.bool_)
    for start, end in edges.reshape(-1, 2).tolist():
        out[start:end] = end - start >= _RUN
    return out
