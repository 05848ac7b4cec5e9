"""A row of a store, as arrays by path, made into the episode that was written there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.episode import CameraFrames, Episode, EpisodeSpec
from grasp_factory.outcome import Outcome

Row = dict[str, NDArray[Any]]
"""Values of one episode by path, streams trimmed."""

NEEDED = frozenset(
    ("status", "checksum", "success", "outcome", "spec", "error", "n_steps", "n_imu", "n_video")
)
"""Columns that are not in ``Episode.columns``."""


def assemble(row: Mapping[str, NDArray[Any]], cameras: Iterable[str]) -> Episode:
    """Return the episode of a row.

    Args:
        row: See ``Row``.
        cameras: Their names.

    Raises:
        KeyError: if an array is missing.
        TypeError: if a camera has another array than ``CameraFrames``.
        ValueError: if the recipe or the outcome cannot be read.
        RecursionError: if the recipe is nested beyond reading.
    """
    groups: dict[str, dict[str, Any]] = {}
    for path, value in row.items():
        top = path.partition("/")[0]
        group, name = path.rsplit("/", 1) if top == "cameras" else path.split("/", 1)
        groups.setdefault(group, {})[name] = value
    columns = groups["episodes"]
    return Episode(
        spec=EpisodeSpec.from_json(str(columns["spec"])),
        outcome=Outcome(int(columns["outcome"])),
        columns={name: _plain(v) for name, v in columns.items() if name not in NEEDED},
        cameras={name: CameraFrames(**groups[f"cameras/{name}"]) for name in cameras},
        streams=groups["streams"],
        imu=groups["imu"],
        videos=groups.get("videos", {}),
    )


def fixed(value: Any) -> NDArray[Any]:
    """Return a value as an array; words get a type of fixed length, as an episode has them."""
    array = np.asarray(value)
    return np.array(array.tolist(), np.str_) if array.dtype.kind == "T" else array


def _plain(value: NDArray[Any]) -> Any:
    """Return a single value as a Python one; ``Episode.contents`` turns it back exactly."""
    return value.item() if value.ndim == 0 else value
