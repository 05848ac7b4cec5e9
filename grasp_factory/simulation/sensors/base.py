"""The base class of sensors: they sample at a fixed rate and return arrays at the end."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import NDArray

from grasp_factory.core.enums import Phase
from grasp_factory.simulation.scene import Scene
from grasp_factory.simulation.world import EngineRow


@dataclass(frozen=True, kw_only=True)
class Tick:
    """One instant at which sensors are sampled: it follows a physics step.

    State that several sensors need is read from the world once, when the first one asks for it.
    """

    scene: Scene
    timestamp: float
    """Simulation time since the arm started, seconds."""
    phase: Phase
    joint_position_targets: Sequence[float]
    """(J,) rad, as commanded for the last step."""
    gripper_width_target: float
    """Metres, as commanded for the last step."""
    shake_level: float
    """Level of the shake in units of standard gravity, 0 outside the shake."""

    @cached_property
    def joints(self) -> Sequence[EngineRow]:
        """States of the arm's joints, the fingers' and the wrist sensor's (``Robot.joint_states``).

        The state of the wrist sensor is valid only at the records of the streams: between them the
        sensor is off.
        """
        return self.scene.robot.joint_states()

    @cached_property
    def frames(self) -> Sequence[EngineRow]:
        """Position and quat_xyzw of the hand and of both pad links, world (``Robot.frames``)."""
        return self.scene.robot.frames()

    @cached_property
    def contacts(self) -> Sequence[EngineRow]:
        """All contact rows of the robot in the last step (``World.contacts``)."""
        body = self.scene.robot.body
        return [c for c in self.scene.world.contacts() if body in (c[1], c[2])]


class Sensor(abc.ABC):
    """A sensor in one attempt. Its row of ``core.sensors.SENSORS`` has its rate and its arrays."""

    @abc.abstractmethod
    def __init__(self, scene: Scene) -> None:
        """Start without samples, before the arm moves."""

    @abc.abstractmethod
    def sample(self, tick: Tick) -> None:
        """Read and store state, without stepping the world; ``arrays`` does the arithmetic."""

    @abc.abstractmethod
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the row's fields, by their names within the group.

        Time series are (samples, ...); units, frames and types are those of the fields. A field
        whose path contains ``{camera}`` has one array for each camera of the recipe.
        """
