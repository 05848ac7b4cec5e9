"""Labels against finer physics, and success per policy on held-out objects."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from grasp_factory.apps.physics_check.figure import Figure, at_most, percentiles
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode, EpisodeSpec
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

FINER = 4
"""Factor by which the comparison increases the step rate of the contact phases."""
POLICY_BOUNDS = {"antipodal": (80.0, 100.0), "top_down": (65.0, 100.0), "uniform": (20.0, 45.0)}
"""Bounds of the success rate on held-out blobs, per cent of the attempts."""


def against_finer_steps(world: World, episodes: Sequence[Episode]) -> list[Figure]:
    """Run the same specs with finer steps from the closing phase on, and compare the labels."""
    pairs = []
    for episode in episodes:
        physics = episode.spec.physics
        finer = dataclasses.replace(physics, contact_hz=FINER * physics.contact_hz)
        again = run_episode(world, dataclasses.replace(episode.spec, physics=finer))
        pairs.append((episode.outcome, again.outcome))
    n = len(pairs)
    same = sum((a is Outcome.SUCCESS) == (b is Outcome.SUCCESS) for a, b in pairs)
    coarse, fine = (sum(pair[k] is Outcome.SUCCESS for pair in pairs) for k in (0, 1))
    check = f"labels with {FINER} times finer contact steps"
    figures = [
        Figure(check=check, figure="agree", value=100.0 * same / n, unit="%", low=97.0,
               high=100.0, samples=n),
        at_most(check, "success rate differs", 100.0 * abs(coarse - fine) / n, 1.0, unit="points",
                samples=n),
    ]  # fmt: skip
    for outcome in Outcome:
        mine = [b for a, b in pairs if a is outcome]
        if mine:
            kept = 100.0 * float(np.mean([b is outcome for b in mine]))
            figures.append(Figure(check=check, figure=f"{outcome.name.lower()} stays", value=kept,
                                  unit="%", low=0.0, high=100.0, samples=len(mine)))  # fmt: skip
    return figures


def overlaps(episodes: Sequence[Episode]) -> list[Figure]:
    """Return how deep pads sink into the held object, and the robot into the table, millimetres."""
    pads = [1e3 * e.columns["max_penetration"] for e in episodes if e.success]
    table = [
        1e3 * e.columns["table_penetration"]
        for e in episodes
        if e.outcome is not Outcome.COLLISION and e.n_steps
    ]
    return [
        *percentiles("pads in the target during the hold", pads, {99: 1.0}, unit="mm"),
        at_most("robot in the table, collisions apart", "largest", max(table, default=np.nan), 1.0,
                unit="mm", samples=len(table)),
    ]  # fmt: skip


def success_of_policies(world: World, attempts: int) -> list[Figure]:
    """Return each policy's success on blobs of the val and test splits."""
    figures = []
    for policy, (low, high) in POLICY_BOUNDS.items():
        config = FactoryConfig(policies={policy: 1.0}, object_sets={"blobs": 1.0})
        recipes = itertools.islice(_held_out(config), attempts)
        rate = float(np.mean([run_episode(world, spec).success for spec in recipes]))
        figures.append(Figure(check="success on held-out blobs", figure=policy,
                              value=100.0 * rate, unit="%", low=low, high=high,
                              samples=attempts))  # fmt: skip
    return figures


def _held_out(config: FactoryConfig) -> Iterator[EpisodeSpec]:
    specs = (sample_spec(config, index) for index in itertools.count())
    return (spec for spec in specs if spec.objects[0].split != "train")
