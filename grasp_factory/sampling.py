"""From (config, index) to the complete recipe of an episode. Pure: numpy and tables only."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

import numpy as np

from grasp_factory.config import FactoryConfig
from grasp_factory.episode import EpisodeSpec, ObjectSpec
from grasp_factory.errors import lookup
from grasp_factory.geometry import Pose, quat_xyzw_to_matrix
from grasp_factory.objects import OBJECT_SETS, ObjectModel
from grasp_factory.policies import POLICIES
from grasp_factory.records import to_plain
from grasp_factory.sections import WorkspaceConfig


class Stream(IntEnum):
    """One random stream per purpose: a draw added to one does not shift the others.

    The values are part of what a seed means: append, never reorder.
    """

    OBJECTS = 0
    POSE = 1
    POLICY_CHOICE = 2
    POLICY = 3


def rng_for(seed: int, index: int, stream: Stream) -> np.random.Generator:
    """Return the generator of one purpose in one episode; it depends on nothing else."""
    sequence = np.random.SeedSequence(seed, spawn_key=(index, int(stream)))
    return np.random.default_rng(sequence)


def sample_spec(config: FactoryConfig, index: int) -> EpisodeSpec:
    """Draw the recipe of episode ``index``.

    Raises:
        UnknownNameError: if the config names an object set or a policy that its table lacks.
    """
    objects = rng_for(config.seed, index, Stream.OBJECTS)
    pose = rng_for(config.seed, index, Stream.POSE)
    choice = rng_for(config.seed, index, Stream.POLICY_CHOICE)
    policy = lookup(POLICIES, "policy", _draw_name(config.policies, choice))
    parameters = policy.settings(config.policy_parameters.get(policy.name, {}))
    return EpisodeSpec(
        index=index,
        seed=config.seed,
        robot=config.robot,
        policy=policy.name,
        policy_parameters=to_plain(parameters),
        objects=(_sample_object(config, objects, pose),),
        cameras=config.cameras,
        resolution=config.resolution,
        record_hz=config.record_hz,
        imu_hz=config.imu_rate,
        workspace=config.workspace,
        physics=config.physics,
        motion=config.motion,
        shake=config.shake,
        label=config.label,
    )


def _sample_object(
    config: FactoryConfig, objects: np.random.Generator, pose: np.random.Generator
) -> ObjectSpec:
    name = _draw_name(config.object_sets, objects)
    model = lookup(OBJECT_SETS, "object set", name).draw(objects)
    return ObjectSpec(
        object_set=name,
        object_id=model.object_id,
        split=model.split,
        mass=model.mass,
        lateral_friction=model.lateral_friction,
        drop_pose=_sample_drop_pose(config.workspace, model, pose),
    )


def _sample_drop_pose(
    workspace: WorkspaceConfig, model: ObjectModel, rng: np.random.Generator
) -> Pose:
    """Draw a pose with uniform orientation whose bounding box hangs above the table."""
    quat = rng.normal(size=4)
    quat /= np.linalg.norm(quat)
    corners = model.corners() @ quat_xyzw_to_matrix(quat).T
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    lower = np.array(workspace.lower[:2]) + workspace.margin
    upper = np.array(workspace.upper[:2]) - workspace.margin
    x, y = rng.uniform(lower, upper) - middle[:2]
    z = rng.uniform(*workspace.drop_height) - corners[:, 2].min()
    qx, qy, qz, qw = (float(q) for q in quat)
    return Pose((float(x), float(y), float(z)), (qx, qy, qz, qw))


def _draw_name(weights: Mapping[str, float], rng: np.random.Generator) -> str:
    """Draw a name by weight; the order of the names does not matter."""
    names = sorted(weights)
    shares = np.array([weights[name] for name in names])
    edges = np.cumsum(shares / shares.sum())
    return names[min(int(np.searchsorted(edges, rng.random(), side="right")), len(names) - 1)]
