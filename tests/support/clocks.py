"""Samples of a device whose clock differs from the host's, and that arrive in batches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ticks = NDArray[np.int64]
FASTEST_S = 0.0004
"""Delay of the fastest batch."""


def batched(*, seconds: float, rate_hz: float, batch_s: float, seed: int) -> tuple[Ticks, Ticks]:
    """Return when samples were taken and when they arrived, ns: a batch arrives as a whole.

    Args:
        seconds: Duration.
        rate_hz: Samples per second.
        batch_s: Time between two transfers, seconds.
        seed: of the delay of each batch: exponential, 0.1 ms in the mean.
    """
    rng = np.random.default_rng(seed)
    taken = (np.arange(int(seconds * rate_hz)) / rate_hz * 1e9).astype(np.int64)
    batch_s *= 1.00031  # no clock is a multiple of another
    number = np.floor(taken / (batch_s * 1e9)).astype(np.int64) + 1
    delay = FASTEST_S + rng.exponential(1e-4, number.max() + 1)
    arrived = np.maximum.accumulate((number * batch_s + delay[number]) * 1e9).astype(np.int64)
    return taken, arrived


def device_times(taken: Ticks, *, drift_ppm: float) -> Ticks:
    """Return the times of a clock that gains so much on the host's."""
    return np.asarray(taken + 10**12 + np.round(taken * drift_ppm * 1e-6).astype(np.int64))
