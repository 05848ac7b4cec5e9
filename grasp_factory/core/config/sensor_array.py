"""The arrays of sensors that are not of this package, as a config describes them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from grasp_factory.core.config.recording import check_name
from grasp_factory.core.field import Field
from grasp_factory.core.sensors import SENSORS, STREAMS
from grasp_factory.core.serialization import check, normalise, to_plain
from grasp_factory.errors import PluginError

MOST_SENSORS, MOST_ARRAYS, MOST_DIMS = 16, 16, 4
MOST_VALUES = 4096
"""Values of one record of one array."""
DTYPES = ("float32", "float64", "int32", "uint8", "bool")
_LONGEST = {"units": 40, "frame": 200, "description": 200}
"""Characters of the texts of an array."""
_TAKEN = {f"{STREAMS.name}/reward"} | {
    field.path for model in SENSORS.values() for field in model.fields
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorArray:
    """A time series of the streams that a sensor of the user records."""

    name: str
    """Name in the group ``streams``: that of the sensor, or one that begins with it and ``_``."""
    shape: tuple[int, ...] = ()
    """Shape of one record."""
    dtype: str = "float32"
    """One of ``DTYPES``."""
    units: str = ""
    frame: str = ""
    description: str = ""
    gaps: bool = False
    """Whether a value may be NaN, which means that the sensor has no value."""

    def __post_init__(self) -> None:
        normalise(self)
        check_name("sensors.name", self.name)
        check(self.path not in _TAKEN, "sensors.name", self.name, "a name that no array has")
        check(self.dtype in DTYPES, f"{self.name}.dtype", self.dtype, ", ".join(DTYPES))
        size = math.prod(self.shape)
        ok = len(self.shape) <= MOST_DIMS and min(self.shape, default=1) > 0
        valid = f"up to {MOST_DIMS} sizes above 0, and {MOST_VALUES} values in a record"
        check(ok and size <= MOST_VALUES, f"{self.name}.shape", list(self.shape), valid)
        for key, longest in _LONGEST.items():
            text = getattr(self, key)
            ok = len(text) <= longest and (text.isprintable() or not text)
            check(ok, f"{self.name}.{key}", text, f"one line of up to {longest} characters")

    @property
    def path(self) -> str:
        """Path of the array in the store."""
        return f"{STREAMS.name}/{self.name}"

    def field(self) -> Field:
        """Return the field of the schema."""
        texts = {"units": self.units, "frame": self.frame, "gaps": self.gaps}
        return STREAMS.series(self.name, self.shape, self.dtype, self.description, **texts)


Sensors = Mapping[str, tuple[SensorArray, ...]]
"""Arrays by the name of the sensor; none where a plugin has not been looked up yet."""


def array_of(field: Field, where: object) -> SensorArray:
    """Return the description of a field that a plugin has.

    Raises:
        PluginError: if it is no time series of the streams with a fixed shape.
        ConfigError: naming another value that is not valid.
    """
    group, _, name = field.path.partition("/")
    fixed = all(isinstance(size, int) for size in field.dims[1:])
    if group != STREAMS.name or field.dims[:1] != (STREAMS.dim,) or not fixed or field.names:
        raise PluginError(
            f"{where}: field {field.path} {field.dims}, valid: STREAMS.series(NAME, SHAPE, DTYPE,"
            " DESCRIPTION) with numbers as SHAPE, and no names"
        )
    return SensorArray(
        name=name,
        shape=tuple(int(size) for size in field.dims[1:]),
        dtype=field.dtype,
        units=field.units,
        frame=field.frame,
        description=field.description,
        gaps=field.gaps,
    )


def check_sensors(sensors: Sensors) -> None:
    """Check the sensors of a config.

    Raises:
        ConfigError: naming what it got and what is valid.
    """
    check(len(sensors) <= MOST_SENSORS, "sensors", len(sensors), f"up to {MOST_SENSORS}")
    names: set[str] = set()
    for sensor, arrays in sensors.items():
        valid = "names that the sensors of this package, which always record, do not have"
        check(sensor not in SENSORS, "sensors", sensor, valid)
        key = f"sensors.{sensor}"
        check(len(arrays) <= MOST_ARRAYS, key, len(arrays), f"up to {MOST_ARRAYS} arrays")
        for array in arrays:
            ok = array.name == sensor or array.name.startswith(f"{sensor}_")
            valid = f"{sensor}, or a name that begins with {sensor}_; each once"
            check(ok and array.name not in names, key, array.name, valid)
            names.add(array.name)


def fields_of(sensors: Sensors) -> Iterator[Field]:
    """Yield the fields of the sensors of a config, in its order."""
    for arrays in sensors.values():
        for array in arrays:
            yield array.field()


def plain_sensors(sensors: Sensors) -> dict[str, Any]:
    """Return the sensors as plain data, without empty values."""
    return {
        sensor: [
            {key: value for key, value in to_plain(array).items() if value} for array in arrays
        ]
        for sensor, arrays in sensors.items()
    }
