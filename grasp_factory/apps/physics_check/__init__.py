"""``grasp-factory check-physics``: every figure that a user may trust, measured on this machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from grasp_factory.apps.physics_check import coulomb, held_object, inertial, label_convergence
from grasp_factory.apps.physics_check.figure import Figure
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.episode import Episode
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World


@dataclass(frozen=True, slots=True)
class Effort:
    """How many episodes to spend."""

    default: int
    """Episodes of the default config."""
    finer: int
    """How many of these are run again with finer steps: many or 0, because one different label
    among a few episodes means nothing."""
    stepwise: int
    """Episodes that are recorded at every physics step."""
    per_policy: int


FULL = Effort(default=300, finer=300, stepwise=20, per_policy=150)
SHORT = Effort(default=48, finer=0, stepwise=4, per_policy=0)
"""With half as many episodes, one light object that swings in the hand decides the median
moment."""


def check_physics(
    effort: Effort, on_part: Callable[[str], None] = lambda part: None
) -> Iterator[Figure]:
    """Measure, and yield each figure as soon as it is known.

    Args:
        effort: ``FULL`` for all figures, ``SHORT`` for the figures that need few episodes.
        on_part: Called with a description of the next measurement.
    """
    with World() as world:
        on_part(f"{effort.default} default episodes")
        default = _episodes(world, FactoryConfig(), effort.default)
        successes = [episode for episode in default if episode.success]
        yield from held_object.at_rest(successes)
        yield from inertial.at_rest(successes)
        yield from inertial.noise_model()
        yield from label_convergence.overlaps(default)
        on_part(f"{effort.stepwise} episodes recorded at every step")
        yield from held_object.in_motion(_successes(world, _stepwise_config(), effort.stepwise))
        on_part("the holding threshold of a cube")
        yield from coulomb.threshold(world)
        if effort.finer:
            on_part(f"{effort.finer} of the default episodes with finer steps")
            yield from label_convergence.against_finer_steps(world, default[: effort.finer])
        if effort.per_policy:
            on_part(f"{effort.per_policy} episodes of each policy on held-out blobs")
            yield from label_convergence.success_of_policies(world, effort.per_policy)


def _episodes(world: World, config: FactoryConfig, n: int) -> list[Episode]:
    return [_without_images(run_episode(world, sample_spec(config, i))) for i in range(n)]


def _successes(world: World, config: FactoryConfig, n: int) -> list[Episode]:
    return [episode for episode in _episodes(world, config, n) if episode.success]


def _stepwise_config() -> FactoryConfig:
    """Return the default contact physics, recorded at every step.

    The rate of the records must divide the step rate of the free motion, so both are equal.
    """
    hz = PhysicsConfig().contact_hz
    physics = PhysicsConfig(free_hz=hz, contact_hz=hz)
    return FactoryConfig(physics=physics, record_hz=hz, policies={"top_down": 1.0})


def _without_images(episode: Episode) -> Episode:
    """Return the episode without its images, which would fill the memory."""
    return dataclasses.replace(episode, cameras={})
