"""Reading rows of a store as arrays by path, and converting them to the written episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import CameraFrames, Episode, EpisodeSpec
from grasp_factory.core.schema import Field
from grasp_factory.core.sensors import series_groups
from grasp_factory.errors import StoreError

Row = dict[str, NDArray[Any]]
"""The values of one episode by path; streams have no padding."""

NEEDED = frozenset(
    ("status", "checksum", "success", "outcome", "spec", "error", "n_steps", "n_imu", "n_video")
)
"""Columns that every store has; ``n_video`` only if there are videos."""
_NOT_IN_COLUMNS = NEEDED | {"array_crc32c", "fingerprint", "seed", "index"}
"""Columns that are not in ``Episode.columns``; lengths of time series are not in it either."""


def read_rows(
    read: Callable[[str, int, int], NDArray[Any]],
    fields: Mapping[str, Field],
    start: int,
    stop: int,
) -> list[Row]:
    """Return rows ``start`` to ``stop`` - 1.

    Args:
        read: A function of a path, start and stop that returns rows of the array at the path,
            (stop - start, ...).
        fields: The fields of the arrays, by path.
        start: The first row.
        stop: The row after the last.

    Raises:
        StoreError: if a time series has no such length as a row says.
    """
    videos = {path: field for path, field in fields.items() if field.is_video}
    others = {path: field for path, field in fields.items() if not field.is_video}
    rows = read_together(read, others, start, stop)
    return [row | read_alone(read, videos, k, row) for k, row in enumerate(rows, start)]


def read_together(
    read: Callable[[str, int, int], NDArray[Any]],
    fields: Mapping[str, Field],
    start: int,
    stop: int,
) -> list[Row]:
    """Return some arrays of rows, reading each array once; see ``read_rows``."""
    at_once = {path: read(path, start, stop) for path in fields}
    rows = [
        {path: fixed(values[k]) for path, values in at_once.items()} for k in range(stop - start)
    ]
    for k, row in enumerate(rows, start):
        for path, field in fields.items():
            if field.length_column:
                row[path] = unpadded(row[path], row[field.length_column], k, field.length_column)
    return rows


def read_alone(
    read: Callable[[str, int, int], NDArray[Any]],
    fields: Mapping[str, Field],
    number: int,
    row: Row,
) -> Row:
    """Return images of one row: those of a whole block may need too much memory.

    Args:
        read: See ``read_rows``.
        fields: The fields of the images, by path.
        number: The row.
        row: Its other arrays.

    Raises:
        StoreError: if a video has no such length as the row says.
    """
    images = {path: read(path, number, number + 1)[0] for path in fields}
    for path, field in fields.items():
        if column := field.length_column:
            images[path] = unpadded(images[path], row[column], number, column)
    return images


def unpadded(values: NDArray[Any], length: Any, row: int, column: str) -> NDArray[Any]:
    """Return a time series of a row without padding.

    Args:
        values: As they are stored, (T, ...).
        length: The value of the column with its length, an integer.
        row: The row, for the message.
        column: The path of that column.

    Raises:
        StoreError: unless the length is from 0 to T.
    """
    end = int(length)
    if not 0 <= end <= len(values):
        what = f"{column}: got {end}, valid: 0 to {len(values)}"
        raise StoreError(f"episode {row} is damaged: {what}; run grasp-factory verify on the store")
    return values[:end]


def assemble(row: Mapping[str, NDArray[Any]], cameras: Iterable[str]) -> Episode:
    """Return the episode of a row.

    Args:
        row: See ``Row``.
        cameras: The names of the cameras.

    Raises:
        KeyError: if an array is missing.
        TypeError: if a camera's arrays are not those of ``CameraFrames``.
        ValueError: if the recipe or the outcome cannot be read.
        RecursionError: if the recipe is nested too deeply.
    """
    groups: dict[str, dict[str, Any]] = {}
    for path, value in row.items():
        top = path.partition("/")[0]
        group, name = path.rsplit("/", 1) if top == "cameras" else path.split("/", 1)
        groups.setdefault(group, {})[name] = value
    columns = groups.pop("episodes")
    # A store that was made before a sensor was added has no length column for it.
    series = {group.name: group.count for group in series_groups() if group.count in columns}
    beside = _NOT_IN_COLUMNS.union(series.values())
    return Episode(
        spec=EpisodeSpec.from_json(str(columns["spec"])),
        outcome=Outcome(int(columns["outcome"])),
        columns={name: _plain(v) for name, v in columns.items() if name not in beside},
        cameras={name: CameraFrames(**groups[f"cameras/{name}"]) for name in cameras},
        streams=groups["streams"],
        own_rate={name: groups[name] for name in series if name != "streams"},
    )


def fixed(value: Any) -> NDArray[Any]:
    """Return a value as an array; text gets a dtype of fixed length, as in an episode."""
    array = np.asarray(value)
    return np.array(array.tolist(), np.str_) if array.dtype.kind == "T" else array


def text_of(row: Mapping[str, NDArray[Any]], path: str) -> str:
    """Return a text of a row; empty if the row has none. ``str`` of an array takes far longer."""
    return str(row[path].item()) if path in row else ""


def is_fill(values: NDArray[Any], fill: Any) -> bool:
    """Return whether values equal the fill value bit by bit: NaN has many bit patterns."""
    if values.dtype.kind == "U":
        return bool((values == fill).all())
    return values.tobytes() == np.asarray(fill, values.dtype).tobytes() * values.size


def _plain(value: NDArray[Any]) -> Any:
    """Return a scalar as a Python value; ``Episode.contents`` converts it back exactly."""
    return value.item() if value.ndim == 0 else value
