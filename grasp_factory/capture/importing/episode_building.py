"""A real episode of the store, from a part of a session; what was not measured stays empty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core import schema
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import UNKNOWN, Outcome
from grasp_factory.core.episode import CameraFrames, Episode, EpisodeSpec
from grasp_factory.core.field import Field
from grasp_factory.core.sensors import series_groups
from grasp_factory.errors import CaptureError

_NOT_COLUMNS = {
    *schema.NOT_IN_AN_EPISODE,
    *(f"episodes/{name}" for name in ("success", "outcome", "spec", "seed", "index")),
    *(group.length_column for group in series_groups()),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """What a session says of an episode."""

    columns: Mapping[str, Any]
    """By name of the column."""
    cameras: Mapping[str, Mapping[str, NDArray[Any]]]
    """By camera and name of the array."""
    series: Mapping[str, Mapping[str, NDArray[Any]]]
    """By group and name of the array; each group has ``timestamp``."""


def build_episode(
    spec: EpisodeSpec, outcome: Outcome, measured: Measured, config: FactoryConfig, joints: int
) -> Episode:
    """Return the episode with every array of its store.

    Args:
        spec: its recipe.
        outcome: its label.
        measured: what is known; everything else is NaN, 255, empty or no sample.
        config: of the store.
        joints: of the store's robot.

    Raises:
        CaptureError: if it does not fit the store.
    """
    size = dict(schema.sizes(config, joints))
    for kind in series_groups():
        samples = len(measured.series.get(kind.name, {}).get("timestamp", ()))
        if samples > size[kind.dim] and kind.rate(config):
            raise CaptureError(
                f"{kind.name} has {samples} samples, and the store has room for"
                f" {size[kind.dim]}: choose a config with a higher rate, or a longer longest_s"
            )
        size[kind.dim] = samples
    columns: dict[str, Any] = {}
    cameras: dict[str, dict[str, Any]] = {name: {} for name in config.cameras}
    series: dict[str, dict[str, Any]] = {}
    for row in schema.expand(config):
        group, name = row.path.split("/", 1)
        shape = schema.shape(row, size)
        if group == "episodes":
            if row.path not in _NOT_COLUMNS:
                columns[name] = _value(row, shape, measured.columns.get(name))
        elif group == "cameras":
            camera, name = name.split("/")
            cameras[camera][name] = _array(row, shape, measured.cameras[camera].get(name))
        else:
            known = measured.series.get(group, {}).get(name)
            series.setdefault(group, {})[name] = _array(row, shape, known)
    series["streams"]["reward"][:] = 0.0
    series["streams"]["reward"][-1:] = outcome is Outcome.SUCCESS
    return Episode(
        spec=spec,
        outcome=outcome,
        columns=columns,
        cameras={name: CameraFrames(**arrays) for name, arrays in cameras.items()},
        streams=series.pop("streams"),
        own_rate=series,
    )


def _value(row: Field, shape: tuple[int, ...], known: Any) -> Any:
    if known is not None and not shape:
        return known
    values = _array(row, shape, None if known is None else np.asarray(known))
    return values if shape else values.item()


def _array(row: Field, shape: tuple[int, ...], known: NDArray[Any] | None) -> NDArray[Any]:
    """Return an array of the store's type, filled with what stands for "not measured"."""
    if row.dtype == "string":
        return np.full(shape, "") if known is None else np.asarray(known)
    if known is not None:
        return np.ascontiguousarray(known, row.dtype).reshape(shape)
    if row.dtype.startswith("float"):
        return np.full(shape, np.nan, row.dtype)
    return np.full(shape, UNKNOWN if row.names else 0, row.dtype)
