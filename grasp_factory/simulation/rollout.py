"""One episode from its recipe: build, settle, render, plan, execute, render again, label."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import (
    CameraFrames,
    CameraImage,
    Episode,
    EpisodeSpec,
    Grasp,
    GraspPlan,
)
from grasp_factory.core.finite_check import non_finite
from grasp_factory.core.geometry import Array, matrix_to_quat_xyzw
from grasp_factory.core.schema import FIELDS
from grasp_factory.core.sensors import PLUGIN_SENSORS
from grasp_factory.errors import RecipeError, lookup
from grasp_factory.labels.image_metrics import inspect_episode
from grasp_factory.labels.quality import quality_scores, shortcomings
from grasp_factory.labels.rule import Measurements, disturbance, judge, measure
from grasp_factory.policies import POLICIES
from grasp_factory.policies.base import checked_plan
from grasp_factory.robots.trajectory import GraspMotion, plan_motion
from grasp_factory.sampling.spec import Stream, rng_for
from grasp_factory.simulation.grasp_execution import Attempt
from grasp_factory.simulation.scene import (
    Scene,
    Shot,
    build_scene,
    object_poses,
    observe,
    settle,
    take_shots,
)
from grasp_factory.simulation.world import World

HALF_TURN = np.array([-1.0, -1.0, 1.0, 1.0])
"""Factors on the columns of a pose that rotate it by 180 degrees about its approach axis.

For a parallel gripper, this is the same grasp with the fingers swapped."""


def run_episode(world: World, spec: EpisodeSpec) -> Episode:
    """Simulate one recipe; the result depends on the recipe alone.

    Raises:
        RecipeError: if an object cannot be loaded, the simulation diverges, or the episode scores
            less than the recipe asks for.
        UnknownNameError: if the recipe has a name that is not in the tables.
    """
    if spec.recording is not None:
        raise RecipeError(
            f"episode {spec.index} was recorded with real devices: import its session"
            f" {spec.recording.session} again, it cannot be simulated"
        )
    scene = build_scene(world, spec)
    object_com = np.array([world.inertial_frame(body).position for body in scene.objects])
    settled = settle(scene)
    rest_height = float(scene.com()[2])
    rest_pose = object_poses(scene)
    before = take_shots(scene)
    attempt = Attempt(scene)
    chosen: Grasp | None = None
    after = before
    if settled.outcome is not None:
        outcome = settled.outcome
    else:
        plan = _plan(scene, {name: shot.image for name, shot in before.items()})
        chosen, motion = choose(scene, plan)
        if motion is None:
            outcome = Outcome.UNREACHABLE if plan.grasps else Outcome.NO_PLAN
        else:
            assert chosen is not None
            attempt.run(motion, chosen.width)
            after = take_shots(scene)
            outcome = Outcome.COLLISION
    own_rate = attempt.series()
    for group, arrays in own_rate.items():
        _refuse_non_finite({f"{group}/{name}": values for name, values in arrays.items()}, spec)
    streams = own_rate.pop("streams")
    if attempt.has_closed:
        outcome = judge(streams, object_com[0], rest_height, spec.label)
    measured = measure(streams, object_com[0], rest_height)
    displacement, lift = disturbance(streams, object_com, rest_pose)
    streams["reward"] = np.zeros(len(streams["timestamp"]), np.float32)
    streams["reward"][-1:] = outcome is Outcome.SUCCESS
    episode = Episode(
        spec=spec,
        outcome=outcome,
        columns=_columns(spec, chosen, measured)
        | {
            "object_com": object_com,
            "object_rest_pose": rest_pose,
            "object_settled": settled.at_rest,
            "object_displacement": displacement,
            "object_lift": lift,
            "rest_height": rest_height,
            "table_penetration": attempt.table_penetration,
            "collision_body": np.uint8(attempt.touched or 0),
        },
        cameras={name: _frames(before[name], after[name]) for name in before},
        streams=streams,
        own_rate=own_rate,
    )
    episode = _graded(episode)
    _refuse_non_finite(episode.contents(), spec)
    return episode


def choose(scene: Scene, plan: GraspPlan) -> tuple[Grasp | None, GraspMotion | None]:
    """Return the first grasp of a plan that the robot can reach, and the motion to it.

    Of a grasp and its copy rotated by 180 degrees, the one with the shorter path is tried first.
    If no grasp can be reached, the first one is returned without motion.
    """
    robot = scene.robot
    home = np.array(robot.model.home)
    for grasp in plan.grasps:
        turned = dataclasses.replace(grasp, T_world_tcp=grasp.T_world_tcp * HALF_TURN)
        found = plan_motion(robot.chain, home, (grasp, turned), scene.spec.motion)
        if found is not None:
            return found
    return (plan.grasps[0] if plan.grasps else None), None


def _plan(scene: Scene, images: Mapping[str, CameraImage]) -> GraspPlan:
    spec = scene.spec
    policy = lookup(POLICIES, "policy", spec.policy)
    rng = rng_for(spec.seed, spec.index, Stream.POLICY)
    settings = policy.settings(spec.policy_parameters)
    return checked_plan(policy, observe(scene, images), rng, settings)


def _columns(spec: EpisodeSpec, grasp: Grasp | None, measured: Measurements) -> dict[str, Any]:
    target = spec.objects[0]
    T = grasp.T_world_tcp if grasp else np.full((4, 4), np.nan)
    quat: Array = matrix_to_quat_xyzw(T[:3, :3]) if grasp else np.full(4, np.nan)
    return {
        "object_id": target.object_id,
        "object_set": target.object_set,
        "object_family": target.family,
        "split": target.split,
        "policy": spec.policy,
        "grasp_proposer": (grasp.proposer or spec.policy) if grasp else "",
        "object_mass": target.mass,
        "object_ids": np.array([recipe.object_id for recipe in spec.objects]),
        "grasp_position": T[:3, 3].copy(),
        "grasp_quat_xyzw": quat,
        "grasp_width": grasp.width if grasp else float("nan"),
        "grasp_score": grasp.score if grasp else float("nan"),
        **{f.name: getattr(measured, f.name) for f in dataclasses.fields(measured)},
    }


def _graded(episode: Episode) -> Episode:
    """Return the episode with its quality measurements and its score.

    Raises:
        RecipeError: if it scores less than its recipe asks for.
    """
    found, thresholds = inspect_episode(episode), episode.spec.quality
    measured = {f.name: getattr(found, f.name) for f in dataclasses.fields(found)}
    columns = {**episode.columns, **measured}
    score = int(quality_scores(columns, thresholds))
    if score < thresholds.min_score:
        reasons = "; ".join(shortcomings(columns, thresholds))
        raise RecipeError(f"quality {score} is below min_score {thresholds.min_score}: {reasons}")
    return dataclasses.replace(episode, columns={**columns, "quality": score})


def _frames(*shots: Shot) -> CameraFrames:
    images = [shot.image for shot in shots]
    return CameraFrames(
        rgb=np.stack([image.rgb for image in images]),
        depth=np.stack([image.depth for image in images]),
        segmentation=np.stack([image.segmentation for image in images]),
        intrinsics=images[0].intrinsics,
        T_world_camera=np.stack([image.T_world_camera for image in images]),
        visibility=np.stack([shot.visibility for shot in shots]),
    )


def _refuse_non_finite(contents: Mapping[str, NDArray[Any]], spec: EpisodeSpec) -> None:
    """Raise RecipeError with the path of the array in the store if the simulation diverged."""
    own = (row for name in spec.sensors for row in PLUGIN_SENSORS[name].fields)
    if path := non_finite(contents, (*FIELDS, *own)):
        raise RecipeError(f"the simulation of episode {spec.index} diverged: {path} not finite")
