"""How far apart two episodes are, on episodes made by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.fake_episodes import make_episode, small_config

from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.curation.episode_distance import episode_distance, first_different

STEPS = 20
POSE = (0.4, -0.1, 0.05, 0.0, 0.0, 0.6, 0.8)


def made(steps: int = STEPS, **streams: Any) -> Episode:
    """Return an episode whose poses are true ones, and with some streams changed."""
    episode = make_episode(small_config(), 3, steps)
    still = {
        "object_pose": np.tile(np.float32(POSE), (steps, 1, 1)),
        "tcp_pose": np.tile(np.float32(POSE), (steps, 1)),
    }
    columns = {**episode.columns, "object_rest_pose": np.array([POSE])}
    frames = {
        name: replace(f, depth=np.full(f.depth.shape, 0.7, np.float32))
        for name, f in episode.cameras.items()
    }
    return replace(
        episode, columns=columns, cameras=frames, streams={**episode.streams, **still, **streams}
    )


def moved(step: int, metres: float) -> Episode:
    """Return an episode in which the object lies elsewhere from a step on."""
    poses = np.tile(np.float64(POSE), (STEPS, 1, 1))
    poses[step:, 0, 1] += metres
    return made(object_pose=poses.astype(np.float32))


def test_an_episode_is_at_no_distance_from_itself() -> None:
    found = episode_distance(made(), made())
    assert found.recorded == found.replayed
    assert (found.steps_recorded, found.steps_replayed, found.steps_differing) == (STEPS, STEPS, 0)
    for distance in (found.objects_at_end, found.objects_largest, found.tcp_at_end):
        assert (distance.mm, distance.degrees) == (0.0, 0.0)
    assert [(c.differing, c.share, c.depth_p99_mm) for c in found.cameras.values()] == [(0, 0, 0)]


def test_an_object_that_lies_three_millimetres_away_is_three_millimetres_away() -> None:
    found = episode_distance(made(), moved(5, 0.003))
    assert found.objects_at_end.mm == pytest.approx(3.0, abs=1e-4)
    assert found.objects_largest.mm == pytest.approx(3.0, abs=1e-4)
    assert found.objects_largest.degrees == 0.0
    assert found.tcp_largest.mm == 0.0
    assert found.steps_differing == STEPS - 5


def test_an_object_that_comes_back_is_far_only_in_between() -> None:
    poses = np.tile(np.float32(POSE), (STEPS, 1, 1))
    poses[7, 0, 2] += 0.05
    found = episode_distance(made(), made(object_pose=poses))
    assert found.objects_at_end.mm == 0.0
    assert found.objects_largest.mm == pytest.approx(50.0, abs=1e-4)
    assert found.steps_differing == 1


@pytest.mark.parametrize("degrees", [0.001, 1.0, 90.0, 179.0])
def test_a_turn_of_the_hand_is_told_in_degrees(degrees: float) -> None:
    half = math.radians(degrees) / 2.0
    turned = (*POSE[:3], 0.0, 0.0, math.sin(half), math.cos(half))
    straight = (*POSE[:3], 0.0, 0.0, 0.0, 1.0)
    a, b = (made(tcp_pose=np.tile(np.float64(p), (STEPS, 1))) for p in (straight, turned))
    assert episode_distance(a, b).tcp_at_end.degrees == pytest.approx(degrees, rel=1e-6)


def test_a_quaternion_and_its_negative_are_the_same_turn() -> None:
    poses = np.tile(np.float32(POSE), (STEPS, 1))
    poses[:, 3:] *= -1.0
    assert episode_distance(made(), made(tcp_pose=poses)).tcp_largest.degrees == 0.0


@pytest.mark.parametrize("array", ["rgb", "depth", "segmentation"])
def test_ten_pixels_that_changed_are_ten(array: str) -> None:
    a = made()
    (name, frames), *_ = a.cameras.items()
    values = getattr(frames, array).copy()
    values[1, 3, 2:12] += np.asarray(1, values.dtype)
    b = replace(a, cameras={name: replace(frames, **{array: values})})
    found = episode_distance(a, b).cameras[name]
    assert (found.pixels, found.differing) == (2 * 32 * 24, 10)
    assert found.share == pytest.approx(10 / 1536)
    assert found.depth_median_mm == pytest.approx(1000.0 if array == "depth" else 0.0)


def test_depth_differences_are_those_of_the_pixels_that_differ() -> None:
    a = made()
    (name, frames), *_ = a.cameras.items()
    depth = frames.depth.copy()
    depth[0, 0, :30] += np.float32(0.002)
    depth[0, 0, 30:32] += np.float32(0.5)
    found = episode_distance(a, replace(a, cameras={name: replace(frames, depth=depth)}))
    assert found.cameras[name].depth_median_mm == pytest.approx(2.0, abs=1e-3)
    assert found.cameras[name].depth_p99_mm == pytest.approx(500.0, abs=1e-3)


def test_of_episodes_of_different_lengths_what_both_have_is_compared() -> None:
    found = episode_distance(made(STEPS), made(STEPS - 4))
    assert (found.steps_recorded, found.steps_replayed) == (STEPS, STEPS - 4)
    assert found.steps_differing >= 4
    assert found.objects_largest.mm == 0.0
    assert found.objects_at_end.mm == 0.0


def test_nan_in_both_is_no_difference_and_a_pose_of_nan_has_no_distance() -> None:
    poses = np.tile(np.float32(POSE), (STEPS, 1))
    poses[4] = np.nan
    a, b = made(tcp_pose=poses), made(tcp_pose=poses.copy())
    assert episode_distance(a, b).steps_differing == 0
    assert episode_distance(a, b).tcp_largest.mm == 0.0
    nothing = np.full_like(poses, np.nan)
    found = episode_distance(made(tcp_pose=nothing), made())
    assert (found.tcp_largest.mm, found.tcp_at_end.degrees) == (None, None)
    assert found.steps_differing == STEPS


def test_without_an_attempt_the_objects_are_compared_at_rest() -> None:
    a = replace(made(0), outcome=Outcome.NO_PLAN)
    rest = a.columns["object_rest_pose"] + [0.002, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    found = episode_distance(a, replace(a, columns={**a.columns, "object_rest_pose": rest}))
    assert found.objects_at_end.mm == pytest.approx(2.0)
    assert (found.tcp_at_end.mm, found.objects_largest.mm, found.steps_differing) == (None, None, 0)


def test_an_attempt_against_none_tells_outcomes_and_steps() -> None:
    a, b = made(STEPS), replace(made(0), outcome=Outcome.UNREACHABLE)
    found = episode_distance(a, b)
    assert (found.recorded, found.replayed) == (a.outcome.name.lower(), "unreachable")
    assert (found.steps_differing, found.tcp_at_end.mm) == (STEPS, None)


def test_the_first_array_that_differs_is_named_with_how_much() -> None:
    a, b = made().contents(), moved(5, 0.25).contents()
    assert first_different(a, a) == ""
    said = "streams/object_pose: 15 of 140 values differ, by 0.25 at most"
    assert first_different(a, b) == said
    shorter = {path: value for path, value in a.items() if path != "imu/timestamp"}
    assert first_different(a, shorter) == "imu/timestamp is missing in the replay"
    assert first_different(shorter, a) == "imu/timestamp is missing in the store"
