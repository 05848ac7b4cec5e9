"""Sensors, one file each. The table in ``core/sensors.py`` lists them with their arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pkgutil import resolve_name

from grasp_factory.core.sensors import PLUGIN_SENSORS, SENSORS, SensorModel
from grasp_factory.errors import RecipeError, shown
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick
from grasp_factory.simulation.sensors.plugin import PluginSensor

__all__ = ["Sensor", "Tick", "make_sensor", "make_sensors"]


def make_sensors(scene: Scene) -> dict[str, Sensor]:
    """Return the sensors of the table by name, except those that the recipe turns off.

    Those of plugins come last.

    Raises:
        RecipeError: if the recipe names a sensor that is not known.
    """
    models = {name: row for name, row in SENSORS.items() if row.group.rate(scene.spec)}
    return {
        name: make_sensor(model, scene)
        for name, model in (models | plugin_models(scene.spec.sensors)).items()
    }


def make_sensor(model: SensorModel, scene: Scene) -> Sensor:
    """Return the sensor of a row of the table, in a settled scene."""
    if callable(model.implementation):
        return PluginSensor(model, model.implementation, scene)
    sensor: Sensor = resolve_name(model.implementation)(scene)
    return sensor


def plugin_models(names: Sequence[str]) -> dict[str, SensorModel]:
    """Return the rows of sensors that are not of this package.

    Raises:
        RecipeError: naming one that this process has not loaded.
    """
    for name in names:
        if name not in PLUGIN_SENSORS:
            valid = ", ".join(PLUGIN_SENSORS) or "none: it is of a plugin, which must be given"
            raise RecipeError(f"unknown sensor {shown(name)}; valid: {valid}")
    return {name: PLUGIN_SENSORS[name] for name in names}
