from __future__ import annotations

import csv
import dataclasses
from collections import Counter
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

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
from grasp_factory.objects.blobs import BLOBS
from grasp_factory.objects.classic import CLASSIC
from grasp_factory.robots import ROBOTS
from grasp_factory.simulation.world import DATA, World

BLOB_SCALE = 0.015
WALL = 0.05
"""Half the thickness of the walls that feel a shape, metres."""
OVERLAP = 0.005
"""Metres by which the walls reach into a declared box."""
HULL_MARGIN = 0.001
"""Metres that Bullet adds around the convex hull of a mesh."""
PINNED_SPLITS = {
    "blobs/000": "train",
    "blobs/001": "train",
    "blobs/016": "val",
    "blobs/027": "val",
    "blobs/036": "test",
    "blobs/072": "test",
    "classic/cube": "train",
    "classic/sphere": "train",
    "classic/duck": "train",
    "procedural/box/0": "test",
    "procedural/mug/1": "train",
    "procedural/ring/2147483647": "val",
}


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


def obj_vertices(path: Path) -> Array:
    lines = path.read_text(encoding="utf-8").splitlines()
    return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)


@pytest.mark.parametrize("name", OBJECT_SETS)
class TestObjectSet:
    """Every set of the table keeps these promises."""

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


class TestSplits:
    def test_ids_are_unique_over_all_sets(self) -> None:
        ids = [m.object_id for objects in OBJECT_SETS.values() for m in some_models(objects, 1000)]
        assert len(set(ids)) == len(ids)

    def test_splits_are_about_80_10_10(self) -> None:
        for name in ("blobs", "procedural"):
            splits = [model.split for model in some_models(OBJECT_SETS[name], 1000)]
            shares = {split: n / len(splits) for split, n in Counter(splits).items()}
            assert shares == pytest.approx({"train": 0.8, "val": 0.1, "test": 0.1}, abs=0.04)

    def test_splits_of_many_ids_are_80_10_10(self) -> None:
        cube = CLASSIC.models["classic/cube"]
        models = (dataclasses.replace(cube, object_id=f"more/{i}") for i in range(20_000))
        counts = Counter(model.split for model in models)
        shares = {split: n / 20_000 for split, n in counts.items()}
        assert shares == pytest.approx({"train": 0.8, "val": 0.1, "test": 0.1}, abs=0.01)

    @pytest.mark.parametrize("object_id", PINNED_SPLITS)
    def test_an_object_stays_in_its_split(self, object_id: str) -> None:
        objects = OBJECT_SETS[object_id.partition("/")[0]]
        assert objects.model(object_id).split == PINNED_SPLITS[object_id]

    def test_the_split_hangs_on_the_id_alone(self) -> None:
        cube = CLASSIC.models["classic/cube"]
        for objects in OBJECT_SETS.values():
            for model in some_models(objects, 1000):
                namesake = dataclasses.replace(cube, object_id=model.object_id)
                assert namesake.split == model.split

    def test_two_ids_of_one_object_share_its_split(self) -> None:
        cube = CLASSIC.models["classic/cube"]
        copies = [
            dataclasses.replace(cube, object_id=f"more/{i}", split_by="the same") for i in range(50)
        ]
        assert len({model.split for model in copies}) == 1


class TestBlobs:
    def test_the_shape_without_numbers_is_absent(self) -> None:
        assert "nan" in (DATA / "random_urdfs/168/168.obj").read_text(encoding="utf-8").lower()
        assert "blobs/168" not in BLOBS.models

    def test_the_table_lists_every_other_shape(self) -> None:
        folders = {path.name for path in (DATA / "random_urdfs").iterdir() if path.is_dir()}
        assert {row["id"] for row in read_table()} == folders - {"168"}

    def test_the_table_holds_the_boxes_of_the_obj_files(self) -> None:
        for row in read_table()[::25]:
            number = row.pop("id")
            vertices = obj_vertices(DATA / f"random_urdfs/{number}/{number}.obj") * BLOB_SCALE
            box = [*vertices.min(axis=0), *vertices.max(axis=0)]
            np.testing.assert_allclose([float(v) for v in row.values()], box, atol=6e-6)

    def test_the_urdfs_scale_the_meshes_as_the_table_does(self) -> None:
        for model in some_models(BLOBS, 40):
            (mesh, again) = urdf(model).iter("mesh")
            assert mesh.attrib == again.attrib
            assert mesh.attrib["scale"] == f"{BLOB_SCALE} {BLOB_SCALE} {BLOB_SCALE}"

    def test_every_file_has_the_declared_mass(self) -> None:
        for model in BLOBS.models.values():
            (mass,) = urdf(model).iter("mass")
            assert float(mass.attrib["value"]) == model.mass

    def test_what_is_too_flat_or_too_thick_is_left_out(self) -> None:
        for row in read_table():
            low, high = np.split(np.array([float(v) for v in list(row.values())[1:]]), 2)
            small, middle, _ = np.sort(high - low)
            fits = 0.015 <= small <= 0.075 and middle <= 0.100
            assert (f"blobs/{row['id']}" in BLOBS.models) == fits


class TestClassic:
    def test_the_objects_are_these(self) -> None:
        names = ["block", "cube", "domino", "duck", "jenga", "lego", "mug", "sphere", "teddy"]
        assert sorted(CLASSIC.models) == [f"classic/{name}" for name in names]
        assert list(CLASSIC.families) == names


def urdf(model: ObjectModel) -> ElementTree.ElementTree:
    assert isinstance(model.body, UrdfFile)
    return ElementTree.parse(DATA / model.body.path)


def read_table() -> list[dict[str, str]]:
    table = resources.files("grasp_factory.objects") / "blobs.csv"
    return list(csv.DictReader(table.read_text(encoding="ascii").splitlines()))
