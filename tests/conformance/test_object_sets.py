"""The contract of an object set, which every row of ``OBJECT_SETS`` keeps.

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
from pathlib import Path

import numpy as np
import pytest

from grasp_factory.core.config.physics import PhysicsConfig
from grasp_factory.core.geometry import IDENTITY, Array
from grasp_factory.errors import UnknownNameError
from grasp_factory.objects import (
    MAX_PARTS,
    OBJECT_SETS,
    Compound,
    FiniteSet,
    ObjectModel,
    ObjectSet,
    UrdfFile,
    visual_parts,
)
from grasp_factory.objects.base import PRIMITIVES
from grasp_factory.objects.classic import CLASSIC
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.world import DATA, World

WALL = 0.05
"""Half the thickness of the walls that feel a shape, metres."""
OVERLAP = 0.005
"""Metres by which the walls reach into a declared box."""
HULL_MARGIN = 0.001
"""Metres that Bullet adds around the convex hull of a mesh."""


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World() as world:
        yield world


def some_models(objects: ObjectSet, count: int) -> list[ObjectModel]:
    """Return models from all over a finite set, or draws from one without end."""
    if isinstance(objects, FiniteSet):
        return list(objects.models.values())[:: max(1, objects.size // count)]
    rng = np.random.default_rng(0)
    return [objects.draw(rng) for _ in range(count)]


def load(world: World, model: ObjectModel) -> int:
    """Load an object into an empty world, as a scene does, and return the body."""
    world.reset(PhysicsConfig())
    if isinstance(model.body, UrdfFile):
        body = world.load_urdf(
            DATA / model.body.path, IDENTITY, fixed=False, scale=model.body.scale
        )
    else:
        body = world.add_compound(model.body, IDENTITY, mass=model.mass)
    world.change_dynamics(body, -1, mass=model.mass)
    return body


def margin(model: ObjectModel) -> float:
    """Return by how much the loaded shape is larger than the declared one, metres."""
    shapes = {part.shape for part in model.body.parts} if isinstance(model.body, Compound) else {""}
    return 0.0 if shapes <= set(PRIMITIVES) else HULL_MARGIN


def overhang(world: World, model: ObjectModel) -> Array:
    """Return how far the loaded shape reaches beyond its declared box, (2, 3) metres.

    Walls that reach a little into the box feel how deep the shape is in them.
    """
    body = load(world, model)
    box = np.array([model.lower, model.upper])
    walls = {}
    for side, sign in enumerate((-1.0, 1.0)):
        for axis in range(3):
            position = box.mean(axis=0)
            position[axis] = box[side, axis] + sign * (WALL - OVERLAP)
            half_extents = np.full(3, 0.5)
            half_extents[axis] = WALL
            walls[world.add_box(half_extents, position, (1.0, 1.0, 1.0, 1.0))] = side, axis
    world.step()
    depth = np.full((2, 3), -np.inf)
    for row in world.contacts():
        if body in row[1:3]:
            where = walls[row[2] if row[1] == body else row[1]]
            depth[where] = max(depth[where], -row[8])
    return depth - OVERLAP


@pytest.mark.parametrize("name", OBJECT_SETS)
class TestObjectSet:
    @pytest.fixture
    def objects(self, name: str) -> ObjectSet:
        return OBJECT_SETS[name]

    def test_the_set_is_named_described_and_not_empty(self, objects: ObjectSet, name: str) -> None:
        assert objects.name == name
        assert objects.description
        assert objects.size is None or objects.size > 0

    def test_an_object_is_found_by_its_id_which_starts_with_the_set(
        self, objects: ObjectSet
    ) -> None:
        for model in some_models(objects, 60):
            assert model.object_id.startswith(f"{objects.name}/")
            assert objects.model(model.object_id) == model

    def test_the_same_generator_state_draws_the_same_object(self, objects: ObjectSet) -> None:
        first, second, other = (np.random.default_rng(seed) for seed in (5, 5, 6))
        drawn = [objects.draw(first) for _ in range(20)]
        assert [objects.draw(second) for _ in range(20)] == drawn
        assert [objects.draw(other) for _ in range(20)] != drawn

    def test_an_id_that_the_set_lacks_is_refused(self, objects: ObjectSet) -> None:
        for object_id in ("", objects.name, f"{objects.name}/nothing", f"{objects.name}/box/-1"):
            with pytest.raises(UnknownNameError, match=r"^unknown object .*valid: "):
                objects.model(object_id)

    def test_families_are_sorted_and_those_of_the_objects(self, objects: ObjectSet) -> None:
        assert list(objects.families) == sorted(set(objects.families))
        assert {m.family for m in some_models(objects, 400)} == set(objects.families)

    def test_every_file_exists(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 1000):
            if isinstance(model.body, UrdfFile):
                assert (DATA / model.body.path).is_file()
            else:
                for part in (*model.body.parts, *visual_parts(model.body)):
                    assert part.shape in PRIMITIVES or Path(part.shape).is_file()

    def test_a_compound_has_no_more_parts_than_the_engine_takes(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 60):
            if isinstance(model.body, Compound):
                assert 1 <= len(model.body.parts) <= MAX_PARTS
                assert 1 <= len(visual_parts(model.body)) <= MAX_PARTS

    def test_a_mass_is_that_of_something_between_foam_and_steel(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 1000):
            box = float(np.ptp(model.corners(), axis=0).prod())
            assert 15.0 < model.mass / box < 8000.0, model.object_id

    def test_the_loaded_mass_is_the_declared_one(self, objects: ObjectSet, world: World) -> None:
        for model in some_models(objects, 25):
            assert world.mass(load(world, model)) == pytest.approx(model.mass)

    def test_loading_says_nothing(
        self, objects: ObjectSet, world: World, capfd: pytest.CaptureFixture[str]
    ) -> None:
        for model in some_models(objects, 25):
            load(world, model)
        assert capfd.readouterr() == ("", "")

    def test_the_bounding_box_contains_the_loaded_shape(
        self, objects: ObjectSet, world: World
    ) -> None:
        for model in some_models(objects, 100):
            assert overhang(world, model).max() < margin(model) + 1e-4, model.object_id

    def test_the_bounding_box_is_tight(self, objects: ObjectSet, world: World) -> None:
        for model in some_models(objects, 100):
            assert overhang(world, model).min() > -5e-4, model.object_id

    def test_corners_span_the_bounding_box(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 60):
            corners = model.corners()
            assert len(np.unique(corners, axis=0)) == 8
            np.testing.assert_array_equal(corners.min(axis=0), model.lower)
            np.testing.assert_array_equal(corners.max(axis=0), model.upper)

    def test_every_object_fits_between_the_fingers_of_every_robot(self, objects: ObjectSet) -> None:
        narrowest = min(robot.gripper.max_width for robot in ROBOTS.values())
        for model in some_models(objects, 1000):
            assert 0.006 < np.ptp(model.corners(), axis=0).min() < narrowest

    def test_friction_is_that_of_a_dry_solid(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 60):
            assert 0.1 <= model.lateral_friction <= 1.0

    def test_a_color_is_rgb_and_there_where_the_file_has_none(self, objects: ObjectSet) -> None:
        for model in some_models(objects, 60):
            assert (model.color is None) == isinstance(model.body, UrdfFile)
            assert model.color is None or all(0.0 <= value <= 1.0 for value in model.color)

    def test_the_split_depends_on_the_object_alone(self, objects: ObjectSet) -> None:
        cube = CLASSIC.models["classic/cube"]
        for model in some_models(objects, 1000):
            namesake = dataclasses.replace(cube, object_id=model.object_id, split_by=model.split_by)
            assert namesake.split == model.split


def test_ids_are_unique_over_all_sets() -> None:
    ids = [m.object_id for objects in OBJECT_SETS.values() for m in some_models(objects, 1000)]
    assert len(set(ids)) == len(ids)
