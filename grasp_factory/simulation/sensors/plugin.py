"""A sensor of a user, whose arrays are checked."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.sensors import STREAMS, SensorModel
from grasp_factory.errors import RecipeError, shown
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.sensors.base import Sensor, Tick


class PluginSensor(Sensor):
    """Calls a sensor of a user. What that prints goes to stderr."""

    def __init__(self, model: SensorModel, make: Callable[[Scene], Any], scene: Scene) -> None:
        self._model, self._samples = model, 0
        with contextlib.redirect_stdout(sys.stderr):
            self._sensor = make(scene)

    def sample(self, tick: Tick) -> None:
        """Read and store state."""
        self._samples += 1
        with contextlib.redirect_stdout(sys.stderr):
            self._sensor.sample(tick)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return its arrays.

        Raises:
            RecipeError: if they are not those of its fields.
        """
        with contextlib.redirect_stdout(sys.stderr):
            found = self._sensor.arrays()
        wanted = {row.path.partition("/")[2]: row for row in self._model.fields}
        if not isinstance(found, dict) or set(found) != set(wanted):
            names = sorted(map(str, found)) if isinstance(found, dict) else type(found).__name__
            raise self._fault("arrays", shown(names), ", ".join(wanted))
        out = {name: np.asarray(values) for name, values in found.items()}
        for name, row in wanted.items():
            shape = (self._samples, *row.dims[1:])
            got = out[name]
            if got.shape != shape or got.dtype != np.dtype(row.dtype):
                raise self._fault(name, f"{got.dtype} {got.shape}", f"{row.dtype} {shape}")
        return out

    def _fault(self, what: str, got: str, valid: str) -> RecipeError:
        where = f"sensor {self._model.name}: {STREAMS.name}/{what}"
        return RecipeError(f"{where}: got {got}, valid: {valid}")
