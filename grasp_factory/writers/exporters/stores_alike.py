"""Whether the episodes of several stores have the same arrays, so that one export can hold them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.sensor_array import fields_of
from grasp_factory.core.sensors import series_groups
from grasp_factory.errors import UsageError, shown
from grasp_factory.writers.zarr.embedded import embedded_in

_SAME = ("robot", "resolution", "record_hz", "imu_rate", "video_hz")
"""Settings that decide the shapes and clocks of the arrays, besides cameras and clutter."""


def check_alike(stores: Sequence[tuple[Path, FactoryConfig]]) -> None:
    """Check that the episodes of stores have arrays of the same names, shapes, units and rates.

    Args:
        stores: the path and the config of each.

    Raises:
        UsageError: naming the first store that differs, also in what it embeds under one name.
    """
    for path, config in stores[1:]:
        _check_pair(*stores[0], path, config)
    _check_embedded(stores)


def _check_pair(first: Path, of_first: FactoryConfig, other: Path, of_other: FactoryConfig) -> None:
    for what, got, valid in (
        ("cameras", sorted(of_other.cameras), sorted(of_first.cameras)),
        ("objects in a scene", of_other.clutter.count, of_first.clutter.count),
        *((name, getattr(of_other, name), getattr(of_first, name)) for name in _SAME),
        ("sensors of plugins", _added_arrays(of_other), _added_arrays(of_first)),
        ("room for real episodes", _room(of_other), _room(of_first)),
    ):
        if got != valid:
            raise UsageError(
                f"{other}: {what}: got {shown(got)}, valid: {shown(valid)} as in {first}; export"
                " them one by one"
            )


def _check_embedded(stores: Sequence[tuple[Path, FactoryConfig]]) -> None:
    """Check that stores which embed an object set or a model of one name embed the same."""
    known: dict[str, tuple[str, Path]] = {}
    for path, config in stores:
        for name, sha256 in embedded_in(config).items():
            first, owner = known.setdefault(name, (sha256, path))
            if first != sha256:
                raise UsageError(
                    f"{path}: {name} has another content than in {owner}: export the stores one by"
                    " one"
                )


def _room(config: FactoryConfig) -> str:
    """Return which time series of real devices a store has."""
    room = config.capture
    if room is None:
        return "none"
    groups = [group.name for group in series_groups() if group.is_real and group.rate(config)]
    return f"{', '.join(groups)}; taxels {room.taxel_rows} x {room.taxel_columns}"


def _added_arrays(config: FactoryConfig) -> str:
    """Return the arrays of a store's sensors of plugins, with all that a format depends on."""
    arrays = [
        " ".join(filter(None, (row.path, *map(str, row.dims[1:]), row.dtype, row.units, row.frame)))
        + (" with gaps" if row.gaps else "")
        for row in fields_of(config.sensors)
    ]
    return ", ".join(sorted(arrays)) or "none"
