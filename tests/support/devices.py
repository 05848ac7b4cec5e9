"""Drivers that run against their simulators."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from functools import cache
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray
from support.places import TINY

from grasp_factory.capture.devices.base import Device, DeviceModel, class_at
from grasp_factory.capture.samples import Payload, Sample
from grasp_factory.capture.simulators.base import SimulatedDevice
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import GraspFactoryError

PATIENCE_S = 30.0
"""For a machine under load; a test that passes waits for much less."""
LOST_AFTER_S = 2.0
"""A sample that has not come for so long does not come."""


@cache
def noisy_episode() -> Episode:
    """Return a stored episode as noisy sensors measured it."""
    return Dataset(TINY, noise="stereo", noise_seed=4)[0]


def simulator(model: DeviceModel, **playing: Any) -> SimulatedDevice[Any]:
    """Return the simulator of a device."""
    made: SimulatedDevice[Any] = class_at(model.simulator)(noisy_episode(), **playing)
    return made


class DeviceRun:
    """A driver that yields into a list, in a thread of its own."""

    def __init__(self, device: Device[Payload], simulated: SimulatedDevice[Any]) -> None:
        self.device, self.simulated = device, simulated
        self.samples: list[Sample[Any]] = []
        self.error: GraspFactoryError | None = None
        self._thread = Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> float:
        """Stop the driver and return how long it took, s."""
        started = time.monotonic()
        self.device.stop()
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        return time.monotonic() - started

    def wait(self) -> None:
        """Wait until it ends by itself."""
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def _run(self) -> None:
        try:
            for sample in self.device.samples():
                self.samples.append(sample)
        except GraspFactoryError as error:
            self.error = error


@contextmanager
def running(
    model: DeviceModel, simulated: SimulatedDevice[Any], **settings: Any
) -> Iterator[DeviceRun]:
    """Yield a driver that reads a simulator, which plays."""
    with simulated:
        device = model.make({**simulated.settings, **settings})
        device.open()
        run = DeviceRun(device, simulated)
        run.start()
        try:
            simulated.play()
            yield run
        finally:
            run.stop()
            device.close()


def eventually(condition: Callable[[], bool]) -> None:
    """Wait until something is so."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.005)


def played(model: DeviceModel, simulated: SimulatedDevice[Any], **settings: Any) -> DeviceRun:
    """Return a run of a whole track, or of as much as was sent."""
    with running(model, simulated, **settings) as run:
        assert simulated.ended.wait(PATIENCE_S)
        _wait_for_what_is_on_the_way(run)
    return run


def _wait_for_what_is_on_the_way(run: DeviceRun) -> None:
    """Wait until each sent sample has come, or none has come for so long that it is lost."""
    arrived, last = len(run.samples), time.monotonic()
    while len(run.samples) < len(run.simulated.sent) and time.monotonic() - last < LOST_AFTER_S:
        time.sleep(0.02)
        if len(run.samples) != arrived:
            arrived, last = len(run.samples), time.monotonic()
    time.sleep(0.15)  # for one that was not sent


def values(payload: Payload) -> Mapping[str, NDArray[Any]]:
    """Return the arrays and numbers of a payload; what is None is left out."""
    found = {field.name: getattr(payload, field.name) for field in fields(payload)}
    return {
        name: np.asarray(value, np.float64) for name, value in found.items() if value is not None
    }
