from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.config.scene import MAX_OBJECTS, ClutterConfig, WorkspaceConfig
from grasp_factory.core.geometry import Array, apply
from grasp_factory.objects import find_set
from grasp_factory.sampling.placement import GAP, Placed, place_around, place_target
from grasp_factory.sampling.spec import sample_spec

WORKSPACE = WorkspaceConfig()
HAND_HEIGHT = 0.50
"""Metres above the table: the fingertips at home."""
SIDES = st.floats(0.01, 0.2)
BOXES = st.tuples(SIDES, SIDES, SIDES)


def corners_of(sides: tuple[float, ...]) -> Array:
    halves = np.array(sides) / 2.0
    return np.array(list(itertools.product(*zip(-halves, halves, strict=True))))


def place(boxes: list[tuple[float, ...]], seed: int) -> tuple[Placed, list[Placed]]:
    rng = np.random.default_rng(seed)
    target = place_target(WORKSPACE, corners_of(boxes[0]), rng)
    others = [corners_of(box) for box in boxes[1:]]
    return target, place_around(target, WORKSPACE, 0.1, others, rng)


@given(st.lists(BOXES, min_size=1, max_size=8), st.integers(0, 2**32))
def test_no_two_objects_touch_when_they_are_let_go(
    boxes: list[tuple[float, ...]], seed: int
) -> None:
    _, placed = place(boxes, seed)
    for a, b in itertools.combinations(placed, 2):
        gap = np.maximum(a.lower - b.upper, b.lower - a.upper)
        assert gap.max() >= GAP - 1e-9


@given(st.lists(BOXES, min_size=1, max_size=8), st.integers(0, 2**32))
def test_the_target_is_let_go_as_if_it_were_alone(
    boxes: list[tuple[float, ...]], seed: int
) -> None:
    alone, placed = place(boxes, seed)
    assert placed[0] is alone


@given(BOXES, st.integers(0, 2**32))
def test_boxes_are_those_of_the_turned_corners(box: tuple[float, ...], seed: int) -> None:
    target, _ = place([box], seed)
    turned = apply(target.pose.matrix(), corners_of(box))
    np.testing.assert_allclose(turned.min(axis=0), target.lower, atol=1e-12)
    np.testing.assert_allclose(turned.max(axis=0), target.upper, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 5, MAX_OBJECTS])
def test_places_lie_in_the_workspace_and_most_heaps_stay_below_the_hand(count: int) -> None:
    config = FactoryConfig(clutter=ClutterConfig(count=count))
    low = np.array(WORKSPACE.lower[:2]) + WORKSPACE.margin - 1e-9
    high = np.array(WORKSPACE.upper[:2]) - WORKSPACE.margin + 1e-9
    tops = []
    for index in range(60):
        for recipe in sample_spec(config, index).objects:
            model = find_set(recipe.object_set).model(recipe.object_id)
            box = apply(recipe.drop_pose.matrix(), model.corners())
            middle = (box.min(axis=0) + box.max(axis=0)) / 2.0
            assert (middle[:2] >= low).all()
            assert (middle[:2] <= high).all()
            assert box[:, 2].min() >= WORKSPACE.drop_height[0] - 1e-9
            tops.append(box[:, 2].max())
    assert np.percentile(tops, 75) < HAND_HEIGHT


def test_the_target_is_the_same_however_many_fall_with_it() -> None:
    alone, crowd = (FactoryConfig(clutter=ClutterConfig(count=count)) for count in (1, 6))
    for index in range(30):
        assert sample_spec(alone, index).objects[0] == sample_spec(crowd, index).objects[0]
