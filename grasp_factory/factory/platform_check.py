"""Checks before a run continues a store that another platform or other versions began."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.platforms import ACCEPT, Fingerprint, difference, fingerprint_of
from grasp_factory.core.real_columns import Source
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryWarning, StoreMismatchError
from grasp_factory.factory.block_job import shard_rows
from grasp_factory.factory.run_request import Request
from grasp_factory.simulation.fingerprint import fingerprint
from grasp_factory.writers.zarr.files import locate
from grasp_factory.writers.zarr.made_with import changed_versions
from grasp_factory.writers.zarr.store import missing_rows


def check_platform(request: Request) -> None:
    """Check that new rows have the same bytes here as on the platform that began the store.

    If the request accepts another platform, this warns instead of raising.

    Raises:
        StoreMismatchError: if the bytes differ, or that cannot be known, or the store holds real
            episodes.
    """
    path = request.out
    if not (locate(path) / "zarr.json").exists() or not len(rows_to_make(request)):
        return
    dataset = Dataset(path)
    if "source" in dataset.columns and (dataset.column("source") == Source.REAL).any():
        raise StoreMismatchError(
            f"{path} holds real episodes: generate into another store with --out, then merge both"
        )
    attributes = dataset.attributes
    known = fingerprint_of(attributes)
    found = difference(known, fingerprint(request.config))
    if not found:
        return
    begun = _begun(path, known, found)
    if not request.accept_other_platform:
        raise StoreMismatchError(f"{begun}; go on where it was begun, or add {ACCEPT}")
    tell = "new rows say so in episodes/fingerprint"
    warnings.warn(begun if known is None else f"{begun}; {tell}", GraspFactoryWarning, stacklevel=3)


def check_same_platform(store: Dataset, config: FactoryConfig) -> None:
    """Check that this platform makes the same bytes as the one that began a store.

    Raises:
        StoreMismatchError: if it does not, or that cannot be known.
    """
    known = fingerprint_of(store.attributes)
    found = difference(known, fingerprint(config))
    if found:
        begun = _begun(store.paths[0], known, found)
        raise StoreMismatchError(f"{begun}; make another store, with another --seed, and read both")


def _begun(store: Path, known: Fingerprint | None, found: str) -> str:
    if known is None:
        return f"{store} cannot be compared with this platform, because {found}"
    return f"{store} was begun on another platform: {found}, so bytes of new episodes differ"


def rows_to_make(request: Request) -> NDArray[np.int64]:
    """Return the rows that a request has to make in its part of an existing store."""
    part, length = shard_rows(request), len(Dataset(request.out))
    missing = missing_rows(request.out, quarantined=request.retry_quarantined)
    return part[np.isin(part, missing) | (part >= length)]


def warn_of_other_versions(path: Path) -> None:
    """Warn if a store that is continued was begun with other versions."""
    if changed := changed_versions(Dataset(path).attributes):
        what = f"{path} was begun with other versions ({'; '.join(changed)})"
        warnings.warn(f"{what}: bytes may differ from there", GraspFactoryWarning, stacklevel=3)
