"""The columns that only stores with real episodes have, and what simulated rows hold in them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from grasp_factory.core.enums import UNKNOWN, Outcome, names
from grasp_factory.core.field import Field, field


class Source(IntEnum):
    """Where an episode comes from. Stored: append new ones, never reorder."""

    SIMULATED = 0
    REAL = 1


SOURCE = "episodes/source"
_OUTCOMES = tuple(names(Outcome))


def _text(name: str, description: str) -> Field:
    return field(f"episodes/{name}", (), "string", description, is_real=True)


def _seconds(name: str, description: str, **more: Any) -> Field:
    path = f"episodes/{name}"
    return field(path, (), "float64", description, units="s", is_real=True, gaps=True, **more)


def _label(name: str, whose: str) -> Field:
    description = f"the outcome by {whose}; {UNKNOWN} if that says nothing"
    path = f"episodes/{name}"
    return field(path, (), "uint8", description, names=_OUTCOMES, empty=UNKNOWN, is_real=True)


REAL_COLUMNS: tuple[Field, ...] = (
    field(SOURCE, (), "uint8", "where the episode comes from", names=tuple(names(Source)),
          empty=UNKNOWN, is_real=True),
    _text("session", "name of the session that the episode was cut from"),
    _text("recording", "path of the session when it was imported"),
    _seconds("started", "start of the episode, seconds since 1970, UTC", always=True),
    _seconds("duration", "length of the episode", always=True),
    _text("operator", "who ran the session"),
    _text("task", "what was to be done"),
    _text("scenario", "where and how, in the operator's words"),
    _text("weather", "in the operator's words"),
    _text("environment", "JSON: facts of the surroundings"),
    _text("sensor_setup", "JSON: devices, drivers, rates and what the operator says of them"),
    _text("consent", "JSON: what the people in the images agreed to"),
    _text("calibration_sha256", "SHA-256 over the session's calibration files; empty without"),
    _label("label_operator", "the operator"),
    _label("label_gripper", "the gripper's width after closing and at the end"),
    _label("label_force", "the weight at the wrist after the lift"),
    _seconds("sync_spread", "by how much images are farther from the samples of other devices"
             " than half a period: 99 % of them stay within it"),
    _text("sync", "JSON: the spread of paired samples in ms, and each clock's drift and delays"),
)  # fmt: skip
"""The columns, in the order of the schema."""


def is_real(contents: Mapping[str, NDArray[Any]]) -> bool:
    """Return whether a row holds a real episode; simulated stores have no such column."""
    return SOURCE in contents and int(contents[SOURCE]) == Source.REAL


def _nothing(row: Field) -> Any:
    if row.path == SOURCE:
        return int(Source.SIMULATED)
    return row.fill


SIMULATED_COLUMNS: Mapping[str, Any] = MappingProxyType(
    {row.path.removeprefix("episodes/"): _nothing(row) for row in REAL_COLUMNS}
)
"""What a simulated row holds in these columns."""
