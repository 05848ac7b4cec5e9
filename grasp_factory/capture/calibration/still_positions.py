"""The positions in which a sensor lay still, found in one recording of all of them."""

from __future__ import annotations

import numpy as np

from grasp_factory.core.geometry import Array
from grasp_factory.errors import CaptureError

WINDOW_S = 0.5
"""Length of the windows that are judged."""
_LEAST_S = 2.0
"""Shortest stay that counts as a position."""
_MOST_STD = 4.0
"""A window is still if its standard deviation is below so many times that of the stillest ones."""
_LEAST_STD = 0.02
"""m/s2; a sensor without noise is still below it."""
_MOST_SHIFT = 0.3
"""m/s2: a larger step between two windows is a turn."""


def still_positions(specific_force: Array, rate_hz: float) -> Array:
    """Return the mean specific force of each still position, (P, 3) m/s2.

    The recording is judged in windows of half a second: a window is still if it varies little, and
    a position is a row of still windows of two seconds or more, without the first and the last.

    Args:
        specific_force: (N, 3) m/s2.
        rate_hz: Samples per second.

    Raises:
        CaptureError: if there is none.
    """
    length = max(int(WINDOW_S * rate_hz), 2)
    count = len(specific_force) // length
    windows = specific_force[: count * length].reshape(count, length, 3)
    spread, means = windows.std(axis=1).max(axis=1), windows.mean(axis=1)
    quiet = np.percentile(spread, 10.0) if count else 0.0
    is_still = spread < max(_MOST_STD * quiet, _LEAST_STD)
    positions, row = [], list[Array]()
    for mean, still in zip([*means, np.full(3, np.nan)], [*is_still, False], strict=True):
        if still and (not row or np.linalg.norm(mean - row[-1]) < _MOST_SHIFT):
            row.append(mean)
            continue
        if len(row) * WINDOW_S >= _LEAST_S:
            positions.append(np.mean(row[1:-1], axis=0))
        row = [mean] if still else []
    if not positions:
        raise CaptureError(
            "positions: the sensor never lay still for 2 s; valid: each position for 5 s or more"
        )
    return np.array(positions)
