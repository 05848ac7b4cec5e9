"""The stores that networks learn from: opened as one, checked, and named in reports and models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasp_factory.curation.versions.origin import states_of
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.dataset.snapshots.version import rows_sha256
from grasp_factory.errors import UsageError, shown

MOST_STORES = 1000
"""A model's header, of up to 1 MiB, names each with 200 bytes."""


def open_stores(paths: Sequence[Path], noise: str | None = None) -> Dataset:
    """Open one or several stores to learn from, or to be judged on.

    Args:
        paths: Paths or addresses of stores that can be read as one.
        noise: Name of the sensor noise that is added to what is read.

    Raises:
        UsageError: for too many stores, stores that cannot be read as one, or an episode that two
            of them have.
    """
    if len(paths) > MOST_STORES:
        what = f"got {len(paths)} stores, valid: up to {MOST_STORES}"
        raise UsageError(f"{what}; `grasp-factory merge` makes one of several")
    dataset = Dataset(paths, noise=noise)
    if len(paths) > 1:
        _check_no_episode_twice(dataset)
    return dataset


def named_stores(dataset: Dataset) -> dict[str, str] | list[dict[str, str]]:
    """Return path, config, rows and snapshot of a dataset's store, or a list for several."""
    named = []
    for path, config in zip(dataset.paths, _configs(dataset), strict=True):
        store = {"path": str(path), "config_sha256": config}
        for state in states_of([path]):
            store |= {"rows_sha256": state.rows_sha256, "snapshot": state.snapshot}
        named.append(store)
    return named[0] if len(named) == 1 else named


def store_facts(dataset: Dataset) -> dict[str, Any]:
    """Return what a model says of the stores that it learned from: their configs and rows."""
    facts = [
        {"config_sha256": config, "rows_sha256": rows_sha256(path)}
        for path, config in zip(dataset.paths, _configs(dataset), strict=True)
    ]
    return dict(facts[0]) if len(facts) == 1 else {"stores": facts}


def _configs(dataset: Dataset) -> list[str]:
    if len(dataset.paths) == 1:
        return [dataset.config.sha256()]
    return [Dataset(path).config.sha256() for path in dataset.paths]


def _check_no_episode_twice(dataset: Dataset) -> None:
    committed = dataset.committed
    checksums = np.array(dataset.column("checksum")[committed].tolist(), dtype=np.str_)
    order = np.argsort(checksums, kind="stable")
    same = np.flatnonzero(checksums[order][1:] == checksums[order][:-1])
    if len(same):
        rows = committed[order[same[0] : same[0] + 2]].tolist()
        first, second = (_row_text(dataset, row) for row in rows)
        what = f"{first} and {second} are the same episode, of {len(same)} that are there twice"
        raise UsageError(f"{what}; name stores without common episodes, or merge them first")


def _row_text(dataset: Dataset, index: int) -> str:
    path, row = dataset.stored_at(index)
    return f"{shown(str(path))} row {row}"
