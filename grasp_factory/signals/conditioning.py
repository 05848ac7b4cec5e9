"""Low-pass filters for recorded signals."""

# ruff: noqa: PLC0415

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.core.optional import require
from grasp_factory.errors import UsageError


def low_pass(
    values: ArrayLike, rate_hz: float, cutoff_hz: float, *, order: int = 2, is_causal: bool = False
) -> Array:
    """Return signals without what is faster than a cutoff: Butterworth, by SciPy.

    Args:
        values: (N, ...) samples at a constant rate.
        rate_hz: Samples per second.
        cutoff_hz: Frequency at which half of the power is left; below half the rate.
        order: of the filter, 1 to 8.
        is_causal: use no later samples, as a live filter; then the signal is delayed. Otherwise it
            is filtered forwards and backwards: no delay, and a quarter of the power at the cutoff.

    Raises:
        UsageError: for a cutoff, an order or a series that the filter cannot have.
        MissingLibraryError: if SciPy is not installed.
    """
    values = np.asarray(values, np.float64)
    if not 0.0 < cutoff_hz < rate_hz / 2.0:
        valid = f"above 0 and below half the rate, {rate_hz / 2.0:g} Hz"
        raise UsageError(f"low_pass: cutoff_hz {cutoff_hz}, valid: {valid}")
    if not 1 <= order <= 8:
        raise UsageError(f"low_pass: order {order}, valid: 1 to 8")
    if values.ndim == 0 or not np.isfinite(values).all():
        raise UsageError("low_pass: valid: an array (N, ...) of finite numbers")
    require("scipy", extra="filters")
    from scipy.signal import butter, sosfilt, sosfilt_zi, sosfiltfilt

    sections = butter(order, cutoff_hz, fs=rate_hz, output="sos")
    if not len(values):
        return values
    if not is_causal:
        most = 3 * (2 * len(sections) + 1)  # SciPy's default of mirrored samples at both ends
        padding = min(most, len(values) - 1)
        return np.asarray(sosfiltfilt(sections, values, axis=0, padlen=padding))
    steady = sosfilt_zi(sections).reshape(-1, 2, *[1] * (values.ndim - 1))
    filtered, _ = sosfilt(sections, values, axis=0, zi=steady * values[:1])
    return np.asarray(filtered)
