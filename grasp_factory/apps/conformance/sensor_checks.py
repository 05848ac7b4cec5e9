"""The checks of a sensor, in a simulated attempt."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.sensors import PLUGIN_SENSORS, SensorModel
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.scene import build_scene
from grasp_factory.simulation.sensors import make_sensor
from grasp_factory.simulation.world import World

CONFIG = FactoryConfig(resolution=(32, 24), policies={"top_down": 1.0})
INDEXES = (0, 1)
"""Episodes in which a sensor is checked."""


def is_empty_without_samples(model: SensorModel) -> str:
    """Check that a sensor which has not sampled returns its arrays, without records."""
    with World() as world:
        scene = build_scene(world, sample_spec(CONFIG, INDEXES[0]))
        make_sensor(model, scene).arrays()  # checks names, shapes and types
    return ""


def repeats(model: SensorModel) -> str:
    """Check that the same recipe gives the same values."""
    for index in INDEXES:
        first, second = (_recorded(model, index) for _ in range(2))
        for path, values in first.items():
            if values.tobytes() != second[path].tobytes():
                return f"{path} of episode {index} has other values the second time"
    return ""


def changes_nothing(model: SensorModel) -> str:
    """Check that all other arrays are the same without the sensor."""
    for index in INDEXES:
        with_it, without = _recorded(model, index), _recorded(None, index)
        for path, values in without.items():
            if path != "episodes/spec" and values.tobytes() != with_it[path].tobytes():
                return f"{path} of episode {index} has other values without the sensor"
    return ""


SENSOR_CHECKS: Mapping[str, Callable[[SensorModel], str]] = {
    "without a sample its arrays are empty, and those that it names": is_empty_without_samples,
    "the same recipe gives the same values": repeats,
    "it changes no other array": changes_nothing,
}
"""Each returns what is wrong, or nothing."""


def _recorded(model: SensorModel | None, index: int) -> dict[str, NDArray[Any]]:
    """Return the contents of an episode, with the sensor or without."""
    spec = sample_spec(CONFIG, index)
    if model is None:
        return _contents(spec)
    known = PLUGIN_SENSORS.get(model.name)
    PLUGIN_SENSORS[model.name] = model
    try:
        return _contents(dataclasses.replace(spec, sensors=(model.name,)))
    finally:
        if known is None:
            del PLUGIN_SENSORS[model.name]


def _contents(spec: Any) -> dict[str, NDArray[Any]]:
    with World() as world:
        return {path: np.asarray(v) for path, v in run_episode(world, spec).contents().items()}
