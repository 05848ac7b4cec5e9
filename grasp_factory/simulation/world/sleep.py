"""Exclude bodies at rest from the simulation until they are needed."""

from __future__ import annotations

from collections.abc import Iterable

from grasp_factory.simulation.world.client import World
from grasp_factory.simulation.world.engine import p

# Without ENABLE_SLEEPING the engine wakes a body at its next step.
_SLEEP = p.ACTIVATION_STATE_SLEEP | p.ACTIVATION_STATE_ENABLE_SLEEPING
_WAKE = p.ACTIVATION_STATE_WAKE_UP | p.ACTIVATION_STATE_DISABLE_SLEEPING


def put_to_sleep(world: World, bodies: Iterable[int]) -> None:
    """Let bodies that are at rest sleep: they keep their pose and cost no time.

    A sleeping body is simulated while an awake body touches it. It falls asleep again when that
    contact ends, at any pose, so wake it before it is moved.
    """
    for body in bodies:
        world.change_dynamics(body, -1, activationState=_SLEEP)


def wake(world: World, bodies: Iterable[int]) -> None:
    """Wake bodies up, so that they are simulated again."""
    for body in bodies:
        world.change_dynamics(body, -1, activationState=_WAKE)
