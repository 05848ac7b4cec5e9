"""What every sensor of the attempt does: sample at each record, hand over streams at the end."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from grasp_factory.core.enums import Phase


@dataclass(frozen=True, slots=True)
class Tick:
    """One record's instant: what the rollout already knows when sensors are sampled."""

    timestamp: float
    """Simulation time since the arm started, seconds."""
    phase: Phase
    joint_position_targets: Sequence[float]
    """(J,) rad, as commanded for the step just made."""
    gripper_width_target: float
    """Metres, as commanded for the step just made."""
    shake_level: float
    """Level of the shake in units of standard gravity, 0 outside of it."""
    joints: Sequence[tuple[Any, ...]]
    """States of the arm's joints, the fingers' and the wrist sensor's (``World.joint_states``)."""
    frames: Sequence[tuple[Any, ...]]
    """Position and quat_xyzw of the hand and of both pad links, world (``Robot.frames``)."""
    contacts: Sequence[tuple[Any, ...]]
    """All contact rows of the robot in the step just made (``World.contacts``)."""


class Sensor(abc.ABC):
    """A stream source. Sampling only stores raw rows; the arithmetic is done once, in numpy."""

    @abc.abstractmethod
    def sample(self, tick: Tick) -> None:
        """Read the world without stepping it."""

    @abc.abstractmethod
    def streams(self) -> dict[str, NDArray[Any]]:
        """Return the streams by name, each (samples, ...), in ``schema.py``'s units and types."""
