"""Values as a device's whole numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def counts(values: ArrayLike, scale: ArrayLike, bits: int, *, is_signed: bool = True) -> list[int]:
    """Return values as counts of a scale, saturated at the ends of the type."""
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if is_signed else (0, 2**bits - 1)
    whole = np.rint(np.atleast_1d(np.asarray(values, np.float64)) / np.asarray(scale, np.float64))
    return [int(value) for value in np.clip(whole, low, high).ravel()]
