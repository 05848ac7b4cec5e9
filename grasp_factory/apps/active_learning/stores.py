"""Make or complete the stores of a flywheel, and record the provenance of each."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.platforms import difference, fingerprint_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import FailuresError, StoreMismatchError
from grasp_factory.factory.generate import generate
from grasp_factory.factory.run_records import Summary
from grasp_factory.factory.run_request import Request
from grasp_factory.simulation.fingerprint import fingerprint

Make = Callable[[Request], Summary]
"""Makes the episodes of a request that are missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StoreFacts:
    """The provenance of the episodes in a store."""

    path: str
    """Relative to the flywheel's folder."""
    seed: int
    config_sha256: str
    contents_sha256: str
    """SHA-256 over the row numbers and checksums of the episodes."""
    episodes: int
    successes: int
    quarantined: int


def make_quietly(request: Request) -> Summary:
    """Make the missing episodes of a request without reporting progress."""
    return generate(request.config, request.n, request.out, request.workers)


def complete(path: Path, config: FactoryConfig, n: int, *, workers: int, make: Make) -> Dataset:
    """Make sure that the store at a path holds ``n`` episodes of a config, and open it.

    Raises:
        StoreMismatchError: if the store was begun on a platform that makes other bytes.
        UsageError, StoreError, WorkerError: as ``factory.generate`` does.
        FailuresError: if too many episodes are quarantined.
    """
    _check_platform(path, config)
    summary = make(Request(config=config, n=n, out=path, workers=workers))
    if summary.failed:
        raise FailuresError(
            f"{len(summary.quarantined)} of {summary.asked} episodes of {path} are quarantined;"
            f" `grasp-factory info {path}` counts them"
        )
    return Dataset(path)


def _check_platform(path: Path, config: FactoryConfig) -> None:
    """Check that an existing store was begun on a platform with the same fingerprint."""
    if not (path / "zarr.json").exists():
        return
    known = fingerprint_of(Dataset(path).attributes)
    if found := difference(known, fingerprint(config)):
        what = f"{path} was begun on another platform: {found}"
        raise StoreMismatchError(
            f"{what}; go on with the flywheel where it was begun, or begin one in another folder"
        )


def store_facts(folder: Path, dataset: Dataset) -> StoreFacts:
    """Return the provenance of a store in a flywheel's folder."""
    rows = dataset.committed
    digest = hashlib.sha256()
    for row, checksum in zip(rows.tolist(), dataset.column("checksum")[rows], strict=True):
        digest.update(f"{row} {checksum}\n".encode())
    return StoreFacts(
        path=dataset.path.relative_to(folder).as_posix(),
        seed=dataset.config.seed,
        config_sha256=dataset.config.sha256(),
        contents_sha256=digest.hexdigest(),
        episodes=len(rows),
        successes=int(dataset.column("success")[rows].sum()),
        quarantined=len(dataset) - len(rows),
    )
