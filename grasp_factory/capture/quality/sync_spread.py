"""How far apart the samples of two streams are that belong together."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.signals.timeline import Ticks, nearest

_QUANTILE = 0.99
_BLOCKS = 20
"""Parts of a session in each of which the sample that came fastest is looked for."""
_NS = 1e-9


def host_times(log_time_ns: Ticks, device_ns: Ticks | None) -> Ticks:
    """Return the host's times of samples without the delays of single samples.

    A line through the fastest arrivals, one in each of 20 parts of the session, maps the device's
    clock to the host's: a later arrival is a delay. Without a device clock, the times of arrival.

    Args:
        log_time_ns: (N,) times of arrival.
        device_ns: (N,) times of the device, ascending, or None.
    """
    if device_ns is None or len(device_ns) < 2 * _BLOCKS or (np.diff(device_ns) <= 0).any():
        return log_time_ns
    passed = (device_ns - device_ns[0]).astype(np.float64)
    delay = (log_time_ns - log_time_ns[0]).astype(np.float64) - passed
    parts = np.array_split(np.arange(len(delay)), _BLOCKS)
    fastest = np.array([part[np.argmin(delay[part])] for part in parts])
    slope, start = np.polyfit(passed[fastest], delay[fastest], 1)
    return np.asarray(log_time_ns[0] + np.rint(passed * (1.0 + slope) + start).astype(np.int64))


def sync_spread(images: Ticks, other: Ticks, rate: float) -> float:
    """Return by how much images are farther from another stream than its rate explains.

    For 99 % of the images, the nearest sample of the other stream is at most half of its period
    plus this many seconds away. NaN without images in the time of the other stream.

    Args:
        images: (N,) times of images, ns of the host.
        other: (M,) times of the other stream.
        rate: of the other stream, Hz.
    """
    instants = np.unique(other)
    inside = images[(images >= instants[:1].sum()) & (images <= instants[-1:].sum())]
    if not len(inside) or not math.isfinite(rate):
        return math.nan
    seconds: Array = (instants - instants[0]) * _NS
    at = (inside - instants[0]) * _NS
    found = nearest(seconds, seconds, at, math.inf)
    distance = np.abs(np.asarray(found.values) - at)
    return max(0.0, float(np.quantile(distance, _QUANTILE)) - 0.5 / rate)


def widest_spread(cameras: Mapping[str, Ticks], others: Mapping[str, tuple[Ticks, float]]) -> float:
    """Return the widest spread of any camera and any other stream; NaN without a pair.

    Args:
        cameras: times of images by topic.
        others: times and rate by topic.
    """
    spreads = [
        sync_spread(images, times, rate)
        for images in cameras.values()
        for times, rate in others.values()
    ]
    known = [spread for spread in spreads if not math.isnan(spread)]
    return max(known, default=math.nan)
