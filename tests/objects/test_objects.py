from __future__ import annotations

import csv
import dataclasses
from collections import Counter
from importlib import resources
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from grasp_factory.core.geometry import Array
from grasp_factory.objects import (
    OBJECT_SETS,
    ObjectModel,
    UrdfFile,
)
from grasp_factory.objects.blobs import BLOBS
from grasp_factory.objects.classic import CLASSIC
from grasp_factory.simulation.world import DATA

BLOB_SCALE = 0.015
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


def obj_vertices(path: Path) -> Array:
    lines = path.read_text(encoding="utf-8").splitlines()
    return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)


class TestSplits:
    def test_splits_are_about_80_10_10(self) -> None:
        for name in ("blobs", "procedural"):
            objects, rng = OBJECT_SETS[name], np.random.default_rng(0)
            splits = [objects.draw(rng).split for _ in range(1000)]
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
        for model in list(BLOBS.models.values())[::20]:
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
