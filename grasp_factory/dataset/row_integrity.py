"""What the values of a row must match: its checksum, the digests of its arrays, its fingerprint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.content_checksum import checksum
from grasp_factory.core.platforms import FINGERPRINT, is_fingerprint
from grasp_factory.writers.zarr.array_reader import StoredArray
from grasp_factory.writers.zarr.digests import digest
from grasp_factory.writers.zarr.header import SOURCES, recorded_arrays

QUARANTINE_PATHS = ("episodes/spec", "episodes/seed", "episodes/index", schema.ERROR.path)
"""Paths of the values that a store keeps of a quarantined episode."""


def episode_contents(row: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the values of a row that its checksum covers, by path."""
    return {path: v for path, v in row.items() if path not in schema.NOT_IN_AN_EPISODE}


def quarantine_checksum(row: Mapping[str, NDArray[Any]]) -> str:
    """Return the checksum that a quarantined row must have.

    Args:
        row: values by path; it has all of ``QUARANTINE_PATHS``.
    """
    return checksum({path: row[path] for path in QUARANTINE_PATHS})


def digested_paths(arrays: Mapping[str, StoredArray]) -> tuple[str, ...]:
    """Return the paths of the arrays that have digests, in the order of the digests.

    Args:
        arrays: the arrays of a store, by path; without the array of digests, or if its list of
            paths is damaged, the result is empty.
    """
    if schema.DIGESTS.path not in arrays:
        return ()
    array = arrays[schema.DIGESTS.path].zarr
    return recorded_arrays({"attributes": array.attrs.asdict(), "shape": list(array.shape)})


def mismatched(
    contents: Mapping[str, NDArray[Any]], paths: Iterable[str], digests: NDArray[np.uint32]
) -> dict[str, bool]:
    """Return, for each array that could be read, whether it differs from its digest.

    Args:
        contents: unpadded values of an episode, by path.
        paths: see ``digested_paths``.
        digests: the digests of the row, (A,), in the order of the paths.
    """
    pairs = zip(paths, digests.tolist(), strict=True)
    return {path: digest(contents[path]) != stored for path, stored in pairs if path in contents}


def must_have_fingerprints(attributes: Mapping[str, Any]) -> bool:
    """Return whether each row of a store must have the fingerprint of its platform.

    Rows of a merged store, or of a store made without fingerprints, may have none.

    Args:
        attributes: the attributes of the store's root.
    """
    return FINGERPRINT in attributes and SOURCES not in attributes


def is_valid_fingerprint(text: str, *, required: bool) -> bool:
    """Return whether a row's fingerprint is valid; it may be empty if none is required."""
    return is_fingerprint(text) or not (text or required)
