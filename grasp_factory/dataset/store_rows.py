"""Rows of several stores that are read as one, store by store."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.joined_stores import places_by_store


def store_rows(
    dataset: Dataset, rows: NDArray[np.int64], *, checked: bool
) -> list[tuple[Dataset, list[int]]]:
    """Return each store that some rows are in, and its rows, in their order.

    Args:
        dataset: One or several stores.
        rows: Row numbers in all of them, (K,); those beyond the end count as the last store's.
        checked: See ``Dataset``.
    """
    if len(dataset.paths) == 1:
        return [(dataset.whole, rows.tolist())]
    starts, noise = dataset.starts, dataset.noise
    places = places_by_store(np.clip(rows, 0, starts[-1] - 1), starts)
    return [
        (
            Dataset(dataset.paths[k], noise.noise, noise.seed, checked=checked),
            (rows[mine] - starts[k]).tolist(),
        )
        for k, mine in places
    ]
