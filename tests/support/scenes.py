"""Small recipes and a cached set of simulated episodes that several test modules share."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import cache

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.enums import Phase
from grasp_factory.core.episode import CameraImage, Episode, EpisodeSpec, ObjectSpec
from grasp_factory.core.geometry import Pose
from grasp_factory.sampling.spec import sample_spec
from grasp_factory.simulation.rollout import run_episode
from grasp_factory.simulation.scene import Scene, take_shots
from grasp_factory.simulation.sensors import Tick
from grasp_factory.simulation.world import EngineRow, World

SMALL = FactoryConfig(resolution=(160, 120))
"""The default config at a resolution that renders quickly and still shows the target."""


def cube_spec(
    position: tuple[float, float, float] = (0.55, 0.05, 0.026),
    quat_xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0),
    **changes: object,
) -> EpisodeSpec:
    """Return a recipe with the classic cube let go at a pose, grasped by ``top_down``."""
    cube = ObjectSpec(
        object_set="classic",
        object_id="classic/cube",
        family="cube",
        split="train",
        mass=0.1,
        lateral_friction=0.5,
        drop_pose=Pose(position, quat_xyzw),
    )
    spec = sample_spec(SMALL, 0)
    return dataclasses.replace(spec, **{"policy": "top_down", "objects": (cube,), **changes})


def tick(scene: Scene, contacts: Sequence[EngineRow] | None = None, timestamp: float = 0.5) -> Tick:
    """Return an instant of the hold, with made-up contacts if any are passed."""
    tick = Tick(
        scene=scene,
        timestamp=timestamp,
        phase=Phase.HOLD,
        joint_position_targets=[0.0] * len(scene.robot.arm),
        gripper_width_target=0.05,
        shake_level=0.0,
    )
    if contacts is not None:
        vars(tick)["contacts"] = contacts
    return tick


def take_images(scene: Scene) -> dict[str, CameraImage]:
    """Return what every camera sees."""
    return {name: shot.image for name, shot in take_shots(scene).items()}


@cache
def default_episodes(count: int) -> tuple[Episode, ...]:
    """Return the first episodes of the default config at low resolution, simulated once."""
    with World() as world:
        return tuple(run_episode(world, sample_spec(SMALL, i)) for i in range(count))
