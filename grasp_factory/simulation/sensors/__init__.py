"""Sensors, one file each. The table in ``core/sensors.py`` lists them with their arrays."""

from __future__ import annotations

from pkgutil import resolve_name

from grasp_factory.core.sensors import SENSORS, SensorModel
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick

__all__ = ["Sensor", "Tick", "make_sensor", "make_sensors"]


def make_sensors(scene: Scene) -> dict[str, Sensor]:
    """Return the sensors of the table by name, except those that the recipe turns off."""
    return {
        name: make_sensor(model, scene)
        for name, model in SENSORS.items()
        if model.group.rate(scene.spec)
    }


def make_sensor(model: SensorModel, scene: Scene) -> Sensor:
    """Return the sensor of a row of the table, in a settled scene."""
    sensor: Sensor = resolve_name(model.implementation)(scene)
    return sensor
