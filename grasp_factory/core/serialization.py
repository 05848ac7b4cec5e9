"""Conversion between frozen dataclasses and plain data (as in JSON and YAML), with checks."""

from __future__ import annotations

import dataclasses
import json
import math
import numbers
import types
import typing
from collections.abc import Hashable, Mapping
from enum import Enum
from functools import cache, lru_cache
from typing import Any, TypeVar, cast

from grasp_factory.errors import ConfigError, did_you_mean, shown

R = TypeVar("R")


def to_plain(value: Any) -> Any:
    """Return a record as nested dicts, lists and scalars; ``from_plain`` is the inverse."""
    if isinstance(value, str | int | float) and not isinstance(value, Enum):
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: to_plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [to_plain(item) for item in value]
    if isinstance(value, Enum):
        return value.name.lower()
    return value


def from_plain(cls: type[R], data: Any, where: str = "") -> R:
    """Return a record of type ``cls`` from plain data; missing keys take the field's default.

    ``where`` is the path of ``data`` in the whole config, for error messages.

    Raises:
        ConfigError: for an unknown key (with the nearest valid one), a missing key without
            default, a wrong type, or a value that the record's own checks reject.
    """
    if not isinstance(data, Mapping):
        raise ConfigError(f"{where or 'config'}: expected a mapping of keys, got {shown(data)}")
    hints = _hints(cast(Any, cls))
    for key in data:
        if key not in hints:
            raise ConfigError(
                f"unknown key {shown(_join(where, str(key)))}{did_you_mean(str(key), hints)}"
                f" (valid: {', '.join(hints) or 'none'})"
            )
    values = {key: _convert(hints[key], item, _join(where, key)) for key, item in data.items()}
    fields = dataclasses.fields(cast(Any, cls))
    missing = [f.name for f in fields if f.name not in values and not _optional(f)]
    if missing:
        raise ConfigError(f"missing key {_join(where, missing[0])!r}")
    try:
        return cls(**values)
    except ConfigError as error:
        raise ConfigError(f"{where}.{error}" if where else str(error)) from None


def from_parsed_json(cls: type[R], data: Any, where: str) -> R:
    """Return a record as ``from_plain`` does, from data that JSON text had.

    A section that many records share is converted once: see ``sections_of``.
    """
    if isinstance(data, dict):
        texts = {key: json.dumps(data[key]) for key in sections_of(cls) if key in data}
        data = data | {
            key: _section(cast(Any, cls), key, text, where)
            for key, text in texts.items()
            if len(text) <= _LONGEST_SHARED
        }
    return from_plain(cls, data, where)


_LONGEST_SHARED = 4096
"""Characters of a section that is kept: those of a stranger may have megabytes."""


@lru_cache(maxsize=64)
def _section(cls: Hashable, key: str, text: str, where: str) -> Any:
    kind = sections_of(cast(Any, cls))[key]
    return from_plain(kind, json.loads(text), _join(where, key))


def normalise(record: Any) -> None:
    """Convert each field of a frozen record to its declared type, in place.

    Equal records are then identical in every bit. It makes no difference whether the caller passed
    1 or 1.0 for a float, a list or a tuple, a number of NumPy or of Python. Call this first in
    ``__post_init__``.

    Raises:
        ConfigError: naming the field, what it got and what is valid.
    """
    hints = _hints(cast(Any, type(record)))
    for field in dataclasses.fields(record):
        value = _convert(hints[field.name], to_plain(getattr(record, field.name)), field.name)
        object.__setattr__(record, field.name, value)


def sections_of(cls: type[Any]) -> dict[str, type[Any]]:
    """Return the types of the fields that are records themselves, by field name."""
    hints = _hints(cast(Any, cls)).items()
    return {name: cast(Any, hint) for name, hint in hints if dataclasses.is_dataclass(hint)}


def is_integer(value: Any) -> bool:
    """Return whether a value is an integer of Python or NumPy; True and False are not."""
    return isinstance(value, numbers.Integral) and not isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Return whether a value is a real number of Python or NumPy; True and False are not."""
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def check(ok: bool, key: str, got: Any, valid: str) -> None:
    """Raise ConfigError, naming the key, the value and the valid values, unless ``ok``."""
    if not ok:
        raise ConfigError(f"{key}: got {shown(got)}, valid: {valid}")


def check_range(record: Any, key: str, low: float, high: float, unit: str = "") -> None:
    """Check that the field ``key`` of a record is a number in [low, high].

    Raises:
        ConfigError: if it is not.
    """
    got = getattr(record, key)
    check(is_number(got) and low <= got <= high, key, got, f"{low} to {high} {unit}".strip())


def _convert(hint: Any, value: Any, where: str) -> Any:
    is_right = hint in (str, int, bool) and type(value) is hint  # of most values
    if is_right or hint is Any:  # what any value is, the code that uses it checks
        return value
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else _convert(args[0], value, where)
    if dataclasses.is_dataclass(hint):
        return value if isinstance(value, hint) else from_plain(hint, value, where)  # type: ignore[arg-type]
    if origin is tuple:
        return _convert_tuple(args, value, where)
    if origin in (dict, Mapping):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a mapping, got {shown(value)}")
        return {str(k): _convert(args[1], v, _join(where, str(k))) for k, v in value.items()}
    return _convert_scalar(hint, value, where)


def _convert_tuple(args: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{where}: expected a list, got {shown(value)}")
    if len(args) == 2 and args[1] is Ellipsis:
        return tuple(_convert(args[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if len(value) != len(args):
        got = f"got {len(value)} in {shown(value)}"
        raise ConfigError(f"{where}: expected {len(args)} values, {got}")
    pairs = zip(args, value, strict=True)
    return tuple(_convert(hint, item, f"{where}[{i}]") for i, (hint, item) in enumerate(pairs))


def _convert_scalar(hint: Any, value: Any, where: str) -> Any:
    if isinstance(hint, type) and issubclass(hint, Enum):
        names = [member.name.lower() for member in hint]
        if value in names:
            return hint[str(value).upper()]
        raise ConfigError(f"{where}: got {shown(value)}, valid: {', '.join(names)}")
    if hint is float and is_number(value):
        number = _float(value)
        if not math.isfinite(number):
            raise ConfigError(f"{where}: expected a finite number, got {shown(value)}")
        return number
    if hint is int and is_integer(value):
        return int(value)
    if type(value) is hint:
        return value
    raise ConfigError(f"{where}: expected {_TYPE_WORDS.get(hint, hint)}, got {shown(value)}")


def _float(value: Any) -> float:
    try:
        return float(value)
    except OverflowError:  # an integer too large for a float
        return math.inf


_TYPE_WORDS = {
    int: "an integer",
    float: "a number",
    str: "a string",
    bool: "true or false",
}


@cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _optional(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _join(where: str, key: str) -> str:
    short = key if len(key) <= 100 else f"{key[:100]}..."
    return f"{where}.{short}" if where else short
