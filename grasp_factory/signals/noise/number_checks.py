"""Functions that the noise models share: check figures, digitise readings."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grasp_factory.core.geometry import Array
from grasp_factory.errors import UsageError


def check_figures(record: Any) -> None:
    """Check that no figure of a model is negative or NaN; None turns an effect off.

    Raises:
        UsageError: naming the model and the figure.
    """
    for field in fields(record):
        value = getattr(record, field.name)
        if value is not None and not all(v >= 0.0 for v in np.ravel(value)):
            name = type(record).__name__
            raise UsageError(f"{name}: {field.name} {value}: valid: 0 or more")


def digitise(signal: ArrayLike, resolution: ArrayLike, full_scale: ArrayLike = math.inf) -> Array:
    """Return a signal rounded to counts, then clipped to plus and minus the full scale.

    Args:
        signal: (..., n), in any unit.
        resolution: Units of the signal per count, a number or (n,); 0 for no quantisation.
        full_scale: In the unit of the signal, a number or (n,).
    """
    signal, step = np.asarray(signal, np.float64), np.asarray(resolution, np.float64)
    counts = np.round(signal / np.where(step > 0.0, step, 1.0))
    return np.clip(np.where(step > 0.0, counts * step, signal), -np.asarray(full_scale), full_scale)
