"""The holding threshold of a box between two pads, against Coulomb's law."""

from __future__ import annotations

import dataclasses

from grasp_factory.apps.physics_check.figure import Figure, at_most
from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.label import LabelConfig
from grasp_factory.core.config.shake import ShakeConfig
from grasp_factory.core.episode import EpisodeSpec, ObjectSpec
from grasp_factory.core.geometry import Pose
from grasp_factory.objects import OBJECT_SETS
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.world import World

EXPECTED_FORCE = 20.0
"""Force in N with which each pad must squeeze the box to hold it, by Coulomb's law."""
RESOLUTION = 0.002
"""The bisection ends at this share of the force."""


def threshold(world: World) -> list[Figure]:
    """Find by bisection the force at which a cube stays, and compare it with 2 mu F = m g."""
    low, high = 0.8 * EXPECTED_FORCE, 1.2 * EXPECTED_FORCE
    while high - low > RESOLUTION * EXPECTED_FORCE:
        force = (low + high) / 2.0
        if _stays(world, force):
            high = force
        else:
            low = force
    error = 100.0 * abs(high / EXPECTED_FORCE - 1.0)
    return [at_most("holding threshold in F against Coulomb", "error", error, 5.0, unit="%")]


def _stays(world: World, force: float) -> bool:
    return run_episode(world, _recipe(force)).success


def _recipe(force: float) -> EpisodeSpec:
    """Return the spec of a slow lift of a cube whose weight the friction just carries."""
    spec = sample_spec(FactoryConfig(policies={"top_down": 1.0}), 0)
    model = OBJECT_SETS["classic"].model("classic/cube")
    mass = 2.0 * model.lateral_friction * EXPECTED_FORCE / spec.physics.gravity
    cube = ObjectSpec(
        object_set="classic",
        object_id=model.object_id,
        family=model.family,
        split=model.split,
        mass=mass,
        lateral_friction=model.lateral_friction,
        drop_pose=Pose((0.55, 0.0, -model.lower[2] + 0.001), (0.0, 0.0, 0.0, 1.0)),
    )
    return dataclasses.replace(
        spec,
        objects=(cube,),
        motion=dataclasses.replace(spec.motion, grip_force=force, lift_speed=0.1, hold_s=0.5),
        shake=ShakeConfig(levels=()),
        label=LabelConfig(min_shake=0.0),
    )
