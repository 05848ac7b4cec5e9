"""The contract of an object set, which every row of ``OBJECT_SETS`` keeps.

Most checks are those of ``grasp-factory conformance``: see ``object_set_checks``. They say:

- The row has the set's name, the set has an object at least, and its families are those of its
  objects, sorted.
- The same random generator draws the same object.
- An object is found by its id, which begins with the set's name; ids are unique over all sets. An
  unknown id is refused with the valid ones.
- An object's split follows from its id, or from what it says instead (``split_by``).
- Every file exists and loads without a message; a compound has no more parts than the engine takes.
- The bounding box contains the loaded shape and is tight; the loaded mass is the declared one.
- Mass, friction and colour are those of a dry solid, and the object fits into every gripper.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from grasp_factory.apps.conformance.object_set_checks import (
    OBJECT_SET_CHECKS,
    load,
    some_models,
)
from grasp_factory.objects import OBJECT_SETS, FiniteSet, ObjectModel, ObjectSet
from grasp_factory.objects.base import Compound, Part
from grasp_factory.simulation.world import World


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


@pytest.mark.parametrize("name", OBJECT_SETS)
class TestObjectSet:
    @pytest.fixture
    def objects(self, name: str) -> ObjectSet:
        return OBJECT_SETS[name]

    @pytest.mark.parametrize("check", OBJECT_SET_CHECKS)
    def test_it_passes(self, objects: ObjectSet, check: str) -> None:
        assert OBJECT_SET_CHECKS[check](objects) == ""

    def test_it_has_the_name_of_its_row(self, objects: ObjectSet, name: str) -> None:
        assert objects.name == name

    def test_loading_says_nothing(
        self, objects: ObjectSet, world: World, capfd: pytest.CaptureFixture[str]
    ) -> None:
        for model in some_models(objects, 25):
            load(world, model)
        assert capfd.readouterr() == ("", "")

    def test_corners_span_the_bounding_box(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 60):
            corners = model.corners()
            assert len(np.unique(corners, axis=0)) == 8
            np.testing.assert_array_equal(corners.min(axis=0), model.lower)
            np.testing.assert_array_equal(corners.max(axis=0), model.upper)


def test_ids_are_unique_over_all_sets() -> None:
    ids = [m.object_id for objects in OBJECT_SETS.values() for m in some_models(objects, 1000)]
    assert len(set(ids)) == len(ids)


SIDE = 0.04
CUBE = ObjectModel(
    object_id="mine/cube",
    family="cube",
    body=Compound(
        parts=(Part(shape="box", size=(SIDE, SIDE, SIDE)),),
        gyration_squared=(SIDE**2 / 6, SIDE**2 / 6, SIDE**2 / 6),
    ),
    lower=(-SIDE / 2, -SIDE / 2, -SIDE / 2),
    upper=(SIDE / 2, SIDE / 2, SIDE / 2),
    mass=0.05,
    lateral_friction=0.5,
    color=(0.5, 0.5, 0.5),
)
CHANGES: dict[str, dict[str, Any]] = {
    "an object is found by its id, which starts with the set": {"object_id": "other/cube"},
    "every file exists": {
        "body": dataclasses.replace(
            CUBE.body, parts=(Part(shape="/nowhere.obj", size=(1.0, 1.0, 1.0)),)
        )
    },
    "a compound has no more parts than the engine takes": {
        "body": dataclasses.replace(CUBE.body, parts=CUBE.body.parts * 17)  # type: ignore[union-attr]
    },
    "a mass is that of something between foam and steel": {"mass": 50.0},
    "the bounding box contains the shape and is tight": {"upper": (0.02, 0.02, 0.04)},
    "every object fits between the fingers": {
        "lower": (-0.2, -0.2, -0.2),
        "upper": (0.2, 0.2, 0.2),
    },
    "friction is that of a dry solid": {"lateral_friction": 3.0},
    "a colour is there where the file has none": {"color": None},
}
"""For some checks, changes of an object that fails it."""


def set_of(model: ObjectModel) -> FiniteSet:
    return FiniteSet(name="mine", description="one object", models={model.object_id: model})


@pytest.mark.parametrize("check", CHANGES)
def test_a_set_that_breaks_a_rule_is_found(check: str) -> None:
    assert OBJECT_SET_CHECKS[check](set_of(CUBE)) == ""
    fault = OBJECT_SET_CHECKS[check](set_of(dataclasses.replace(CUBE, **CHANGES[check])))
    assert fault
    assert "\n" not in fault


def test_a_set_that_does_not_draw_from_the_generator_is_found() -> None:
    class Unseeded(FiniteSet):
        def draw(self, rng: np.random.Generator) -> ObjectModel:
            return super().draw(np.random.default_rng())

    models = {f"mine/{i}": dataclasses.replace(CUBE, object_id=f"mine/{i}") for i in range(50)}
    found = Unseeded(name="mine", description="unseeded", models=models)
    assert OBJECT_SET_CHECKS["the same generator state draws the same object"](found)
