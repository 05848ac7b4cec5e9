"""Draw the complete recipe of an episode from (config, index): pure, with numpy and tables only."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from enum import IntEnum

import numpy as np

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.episode import EpisodeSpec, ObjectSpec
from grasp_factory.core.serialization import to_plain
from grasp_factory.errors import lookup
from grasp_factory.objects import ObjectModel, draw_of, find_set
from grasp_factory.policies import POLICIES
from grasp_factory.sampling.domain_randomization import (
    BodyDraw,
    draw_body,
    draw_cameras,
    draw_motion,
    draw_object_look,
    draw_surroundings,
)
from grasp_factory.sampling.placement import Placed, place_around, place_target

NEIGHBOR_TRIES = 200
"""Number of tries to draw an object of one split. If a tenth of the objects are in the split, one
search in a thousand million fails."""


class Stream(IntEnum):
    """One random stream per purpose: a draw added to one does not shift the others.

    The values are part of the meaning of a seed: append, never reorder.
    """

    OBJECTS = 0
    POSE = 1
    POLICY_CHOICE = 2
    POLICY = 3
    CLUTTER = 4
    """Which objects are around the target, and where."""
    BODIES = 5
    OBJECT_LOOKS = 6
    MOTION = 7
    SURROUNDINGS_CHOICE = 8
    SURROUNDINGS = 9
    """Table, floor and light. This stream and CAMERAS are keyed by the surroundings' id, not by the
    episode's index."""
    CAMERAS = 10


def rng_for(seed: int, index: int, stream: Stream, name: str = "") -> np.random.Generator:
    """Return the random generator of one purpose in one episode; it depends on nothing else.

    Args:
        seed: Seed of the dataset.
        index: Index of the episode.
        stream: The purpose.
        name: Selects one of several generators with the same purpose, such as one per camera.
    """
    more = (zlib.crc32(name.encode()),) if name else ()
    sequence = np.random.SeedSequence(seed, spawn_key=(index, int(stream), *more))
    return np.random.default_rng(sequence)


def sample_spec(config: FactoryConfig, index: int) -> EpisodeSpec:
    """Draw the recipe of episode ``index``.

    Raises:
        UnknownNameError: if the config names an object set or a policy that its table lacks.
    """

    def rng(stream: Stream, number: int = index) -> np.random.Generator:
        return rng_for(config.seed, number, stream)

    ranges = config.randomize
    policy = lookup(POLICIES, "policy", _draw_name(config.policies, rng(Stream.POLICY_CHOICE)))
    parameters = policy.settings(config.policy_parameters.get(policy.name, {}))
    around = index
    if ranges.surroundings:
        around = int(rng(Stream.SURROUNDINGS_CHOICE).integers(ranges.surroundings))
    return EpisodeSpec(
        index=index,
        seed=config.seed,
        robot=config.robot,
        policy=policy.name,
        policy_parameters=to_plain(parameters),
        objects=_sample_objects(config, index),
        surroundings=draw_surroundings(ranges.looks, rng(Stream.SURROUNDINGS, around)),
        cameras=draw_cameras(
            ranges.cameras,
            config.cameras,
            lambda name: rng_for(config.seed, around, Stream.CAMERAS, name),
        ),
        resolution=config.resolution,
        record_hz=config.record_hz,
        imu_hz=config.imu_rate,
        video_hz=config.video_hz,
        workspace=config.workspace,
        physics=config.physics,
        motion=draw_motion(ranges.gripper, config.motion, rng(Stream.MOTION)),
        shake=config.shake,
        label=config.label,
        quality=config.quality,
        sensors=tuple(config.sensors),
    )


def _sample_objects(config: FactoryConfig, index: int) -> tuple[ObjectSpec, ...]:
    """Draw the objects; clutter does not change the target or its pose."""
    others = rng_for(config.seed, index, Stream.CLUTTER)
    drawn = [_draw_model(config, rng_for(config.seed, index, Stream.OBJECTS))]
    for _ in range(1, config.clutter.count):
        drawn.append(_draw_neighbor(config, drawn[0], others))
    bodies = rng_for(config.seed, index, Stream.BODIES)
    body_draws = [draw_body(config.randomize.objects, bodies) for _ in drawn]
    corners = [m.corners() * body.scale for (_, m), body in zip(drawn, body_draws, strict=True)]
    target = place_target(config.workspace, corners[0], rng_for(config.seed, index, Stream.POSE))
    radius = config.clutter.radius
    places = place_around(target, config.workspace, radius, corners[1:], others)
    looks = rng_for(config.seed, index, Stream.OBJECT_LOOKS)
    return tuple(
        _object_spec(config, set_and_model, body, place, looks)
        for set_and_model, body, place in zip(drawn, body_draws, places, strict=True)
    )


def _draw_model(config: FactoryConfig, rng: np.random.Generator) -> tuple[str, ObjectModel]:
    name = _draw_name(config.object_sets, rng)
    found = find_set(name, config.object_folders.get(name, ""))
    return name, draw_of(found, config.object_splits, rng)


def _draw_neighbor(
    config: FactoryConfig, target: tuple[str, ObjectModel], rng: np.random.Generator
) -> tuple[str, ObjectModel]:
    """Draw an object of the target's split, so that none is seen in training and tested later.

    If the draws find none, which can happen with small sets, return the target's object again.
    """
    for _ in range(NEIGHBOR_TRIES):
        name, model = _draw_model(config, rng)
        if model.split == target[1].split:
            return name, model
    return target


def _object_spec(
    config: FactoryConfig,
    set_and_model: tuple[str, ObjectModel],
    body: BodyDraw,
    place: Placed,
    looks: np.random.Generator,
) -> ObjectSpec:
    name, model = set_and_model
    color, texture = draw_object_look(config.randomize.looks, looks)
    return ObjectSpec(
        object_set=name,
        folder_sha256=config.object_folders.get(name, ""),
        object_id=model.object_id,
        family=model.family,
        split=model.split,
        mass=model.mass * body.mass,
        lateral_friction=model.lateral_friction * body.friction,
        drop_pose=place.pose,
        scale=body.scale,
        linear_damping=body.linear_damping,
        angular_damping=body.angular_damping,
        color=color,
        texture=texture,
    )


def _draw_name(weights: Mapping[str, float], rng: np.random.Generator) -> str:
    """Draw a name by weight; the order of the names does not matter."""
    names = sorted(weights)
    shares = np.array([weights[name] for name in names])
    edges = np.cumsum(shares / shares.sum())
    return names[min(int(np.searchsorted(edges, rng.random(), side="right")), len(names) - 1)]
