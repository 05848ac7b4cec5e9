"""Drawn grasps: where they are, how wide, and how they follow others."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.geometry import Array, apply, inverse
from grasp_factory.policies.base import TIP_CLEARANCE
from grasp_factory.policies.candidates import (
    POINTS,
    Candidates,
    Region,
    draw_fitted,
    draw_open,
)
from grasp_factory.policies.top_down import grasp_height
from grasp_factory.robots import ROBOTS

GRIPPER = ROBOTS["kuka_iiwa"].gripper
AIM = 0.035
FITTED = {"aim": 0.02, "clearance": 0.008, "margin": 0.015}

seeds = st.integers(0, 2**32 - 1)


def cloud(seed: int, n: int = 300, size: float = 0.1) -> Array:
    """Return points (n, 3) in a box about (0.5, 0.1), standing on the table."""
    rng = np.random.default_rng(seed)
    sides = rng.uniform(0.005, size, size=3)
    return rng.uniform(-0.5, 0.5, size=(n, 3)) * sides + (0.5, 0.1, sides[2] / 2.0)


def drawn(seed: int) -> tuple[Region, Candidates, Candidates]:
    """Return a region and candidates of both kinds."""
    region = Region.around(cloud(seed), GRIPPER)
    rng = np.random.default_rng(seed)
    return region, draw_open(region, rng, 40, AIM), draw_fitted(region, rng, 40, **FITTED)


@given(seeds)
def test_all_keep_between_the_table_and_the_targets_top_and_the_gripper_within_its_width(
    seed: int,
) -> None:
    region, *both = drawn(seed)
    top = float(region.points[:, 2].max())
    deepest = GRIPPER.tip_distance + TIP_CLEARANCE
    for found in both:
        assert found.tcp[:, 2].min() >= deepest
        assert found.tcp[:, 2].max() <= max(deepest, top)
        assert 0.0 < found.width.min() <= found.width.max() <= GRIPPER.max_width
        assert np.abs(found.yaw).max() <= math.pi / 2.0


@given(seeds)
def test_open_ones_aim_into_the_square_with_the_gripper_fully_open(seed: int) -> None:
    region, found, _ = drawn(seed)
    assert np.abs(found.tcp[:, :2] - region.middle).max() <= AIM
    assert np.ptp(found.tcp[:, :2], axis=0).min() > AIM
    assert set(found.width.tolist()) == {GRIPPER.max_width}


@given(seeds)
def test_fitted_ones_leave_the_same_margin_on_both_sides_of_what_the_fingers_pass(
    seed: int,
) -> None:
    region, _, found = drawn(seed)
    half_strip = GRIPPER.pad_size[0] / 2.0 + FITTED["clearance"]
    fits = found.width < GRIPPER.max_width
    for T, width in zip(found.poses()[fits], found.width[fits], strict=True):
        points = apply(inverse(T), region.points)
        between = points[np.abs(points[:, 0]) < half_strip - 1e-9, 1]
        assert len(between)
        assert width / 2.0 - between.max() >= FITTED["margin"] - 1e-9
        assert width / 2.0 + between.min() >= FITTED["margin"] - 1e-9


@given(seeds)
def test_fitted_ones_close_half_way_up(seed: int) -> None:
    region, _, found = drawn(seed)
    top = float(region.points[:, 2].max())
    np.testing.assert_array_equal(found.tcp[:, 2], grasp_height(top, GRIPPER))


def test_a_strip_without_points_is_aimed_at_all_the_same() -> None:
    apart = np.array([[0.4, 0.0, 0.02], [0.6, 0.0, 0.02]])
    found = draw_fitted(Region.around(apart, GRIPPER), np.random.default_rng(0), 50, **FITTED)
    between = np.abs(found.yaw) > math.radians(80.0)  # there the strips pass between the two
    assert between.sum() > 3
    np.testing.assert_array_equal(found.width[between], 2.0 * FITTED["margin"])
    assert np.abs(found.tcp[between, :2] - (0.5, 0.0)).max() <= FITTED["aim"]


def test_a_large_cloud_is_thinned_evenly() -> None:
    points = cloud(3, n=50_000)
    region = Region.around(points, GRIPPER)
    assert len(region.points) == POINTS
    np.testing.assert_allclose(region.middle, (0.5, 0.1), atol=0.002)


def test_poses_look_down_and_close_along_the_yaw() -> None:
    _, found, _ = drawn(1)
    T = found.poses()
    np.testing.assert_allclose(T[:, :3, 3], found.tcp)
    np.testing.assert_allclose(T[:, :3, 2], np.tile([0.0, 0.0, -1.0], (40, 1)), atol=1e-15)
    np.testing.assert_allclose(np.arctan2(T[:, 1, 1], T[:, 0, 1]), found.yaw)


def test_no_candidates_have_no_poses() -> None:
    _, found, _ = drawn(1)
    assert found.take(np.zeros(40, np.bool_)).poses().shape == (0, 4, 4)
