"""Rows of tables from objects that users write: a function becomes a policy."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

from grasp_factory.core.config.plugin_origin import KINDS
from grasp_factory.core.config.recording import check_name
from grasp_factory.core.config.sensor_array import array_of, check_sensors
from grasp_factory.core.sensors import PLUGIN_SENSORS, SensorModel
from grasp_factory.errors import ConfigError, PluginError, shown
from grasp_factory.objects import OBJECT_SETS, ObjectSet
from grasp_factory.policies import POLICIES, Policy
from grasp_factory.robots import ROBOTS, RobotModel

PluginRow = Policy | RobotModel | ObjectSet | SensorModel

TABLES: dict[str, dict[str, Any]] = {
    "policies": cast(dict[str, Any], POLICIES),
    "robots": cast(dict[str, Any], ROBOTS),
    "object_sets": cast(dict[str, Any], OBJECT_SETS),
    "sensors": cast(dict[str, Any], PLUGIN_SENSORS),
}
"""The tables that plugins add rows to, by kind."""
TYPES: dict[str, type[Any]] = {
    "policies": Policy,
    "robots": RobotModel,
    "object_sets": ObjectSet,
    "sensors": SensorModel,
}
VALID = {
    "policies": "a function plan(view, rng, settings), or a Policy",
    "robots": "a RobotModel",
    "object_sets": "an ObjectSet, such as a FiniteSet",
    "sensors": "a SensorModel",
}
"""What users write, by kind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NoParameters:
    """Settings of a policy that is a function, and has none."""


def kind_of(value: Any, where: object) -> str:
    """Return the kind of an object that a user wrote.

    Raises:
        PluginError: naming what is valid.
    """
    for kind, expected in TYPES.items():
        if isinstance(value, expected) or (kind == "policies" and _is_function(value)):
            return kind
    raise PluginError(f"{where}: got {shown(value)}, valid: {'; '.join(VALID.values())}")


def row_of(kind: str, value: Any, where: object, function_name: str) -> PluginRow:
    """Return the row of a table that an object stands for.

    Args:
        kind: one of ``KINDS``.
        value: the object. A function is a policy without settings.
        where: where it comes from, for messages.
        function_name: the name of the policy if it is a function.

    Raises:
        PluginError: if it is of another kind, or its name is no word.
    """
    is_policy = kind == "policies" and _is_function(value)
    row = _policy(value, where, function_name) if is_policy else value
    if not isinstance(row, TYPES[kind]):
        raise PluginError(f"{where} is no {KINDS[kind]}: got {shown(value)}, valid: {VALID[kind]}")
    try:
        check_name("name", str(getattr(row, "name", "")))
        if isinstance(row, SensorModel):
            check_sensors({row.name: tuple(array_of(field, where) for field in row.fields)})
    except ConfigError as error:
        raise PluginError(f"{where}: {error}") from None
    return cast(PluginRow, row)


def _is_function(value: Any) -> bool:
    return callable(value) and not isinstance(value, (type, *TYPES.values()))


def _policy(function: Callable[..., Any], where: object, name: str) -> Policy:
    """Return the policy that a function stands for."""
    signature = inspect.signature(function)
    try:
        signature.bind(None, None, None)
    except TypeError:
        raise PluginError(f"{where} takes {signature}, valid: (view, rng, settings)") from None
    text = (inspect.getdoc(function) or "").partition("\n")[0].strip()
    return Policy(
        name=name,
        description=text or f"the function {name} of a user",
        parameters=NoParameters,
        plan=function,
    )
