"""The format `ycb`, read with scipy.io.loadmat, OpenCV and trimesh."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from scipy.io import loadmat
from support.fake_episodes import JOINTS, make_rows, small_config
from support.stored import varied

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import CameraFrames, Episode
from grasp_factory.core.geometry import pose_matrices
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import UsageError
from grasp_factory.writers.exporters import ycb
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def out(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset.export("ycb", tmp_path_factory.mktemp("exports") / "out").path


def frames_of(dataset: Dataset, out: Path) -> Iterator[tuple[Episode, CameraFrames, int, str]]:
    """Yield each frame of the export: its episode, its camera's images, 0 or 1, and its path."""
    for place, episode in enumerate(dataset):
        for c, frames in enumerate(episode.cameras.values()):
            for k in (0, 1):
                yield episode, frames, k, f"{out}/data/{place:04d}/{2 * c + k + 1:06d}"


def classes(out: Path) -> dict[str, int]:
    """Return the numbers of the classes by object."""
    return {
        row["object_id"]: row["number"] for row in json.loads((out / "objects.json").read_text())
    }


def test_every_image_is_read_back(dataset: Dataset, out: Path) -> None:
    numbers = classes(out)
    for episode, frames, k, stem in frames_of(dataset, out):
        color = cv2.imread(f"{stem}-color.png")
        np.testing.assert_array_equal(color[..., ::-1], frames.rgb[k])
        depth = cv2.imread(f"{stem}-depth.png", cv2.IMREAD_UNCHANGED)
        assert np.abs(depth / 10_000 - frames.depth[k]).max() <= 0.00005 + 1e-6
        label = cv2.imread(f"{stem}-label.png", cv2.IMREAD_UNCHANGED)
        expected = np.zeros_like(label)
        for m, recipe in enumerate(episode.spec.objects):
            expected[frames.segmentation[k] == Label.TARGET + m] = numbers[recipe.object_id]
        assert label.dtype == np.uint8
        np.testing.assert_array_equal(label, expected)
    assert len(list((out / "data").rglob("*-meta.mat"))) == len(dataset.committed) * 2 * 2


def test_every_matlab_file_has_the_poses_in_metres(dataset: Dataset, out: Path) -> None:
    numbers = classes(out)
    for episode, frames, k, stem in frames_of(dataset, out):
        meta = loadmat(f"{stem}-meta.mat")
        objects = episode.spec.objects
        assert meta["poses"].shape == (3, 4, len(objects))
        assert meta["cls_indexes"].tolist() == [[numbers[r.object_id]] for r in objects]
        assert meta["factor_depth"].tolist() == [[10_000]]
        np.testing.assert_array_equal(meta["intrinsic_matrix"], frames.intrinsics)
        T_camera_world = np.linalg.inv(frames.T_world_camera[k])
        np.testing.assert_allclose(
            meta["rotation_translation_matrix"], T_camera_world[:3], atol=1e-12
        )
        ends = (episode.columns["object_rest_pose"], episode.streams["object_pose"][-1])
        for m in range(len(objects)):
            T = T_camera_world @ pose_matrices(ends[k][m])
            np.testing.assert_allclose(meta["poses"][:, :, m], T[:3], atol=1e-9)
            u, v, w = frames.intrinsics @ T[:3, 3]
            np.testing.assert_allclose(meta["center"][m], [u / w, v / w], atol=1e-6)


def test_the_matlab_file_of_one_object_has_three_dimensions(tmp_path: Path) -> None:
    dataset = made_of(tmp_path / "store.zarr", "procedural/box/1")
    out = dataset.export("ycb", tmp_path / "out").path
    shapes = {loadmat(path)["poses"].shape for path in out.rglob("*-meta.mat")}
    assert (3, 4, 1) in shapes <= {(3, 4, 1), (3, 4, 0)}


def test_boxes_are_those_of_the_masks(dataset: Dataset, out: Path) -> None:
    names = (out / "image_sets/classes.txt").read_text().split()
    for *_, stem in frames_of(dataset, out):
        label = cv2.imread(f"{stem}-label.png", cv2.IMREAD_UNCHANGED)
        boxes = [line.split() for line in Path(f"{stem}-box.txt").read_text().splitlines()]
        assert sorted(names.index(name) + 1 for name, *_ in boxes) == np.unique(label)[1:].tolist()
        for name, *box in boxes:
            rows, columns = np.nonzero(label == names.index(name) + 1)
            ends = (columns.min(), rows.min(), columns.max(), rows.max())
            assert [int(value) for value in box] == list(ends)


def test_a_model_has_its_mesh_and_points_of_its_surface(dataset: Dataset, out: Path) -> None:
    names = (out / "image_sets/classes.txt").read_text().split()
    rows = json.loads((out / "objects.json").read_text())
    recipes = {r.object_id: r for episode in dataset for r in episode.spec.objects}
    assert {path.name for path in (out / "models").iterdir()} == set(names)
    assert [names.index(row["file"].split("/")[1]) + 1 for row in rows] == [
        row["number"] for row in rows
    ]
    for row in rows:
        mesh = trimesh.load(out / row["file"], process=False)
        own = dataset.object_mesh(recipes[row["object_id"]])
        np.testing.assert_allclose(mesh.vertices, own.vertices, atol=6e-7)
        np.testing.assert_array_equal(mesh.faces, own.faces)
        points = np.loadtxt((out / row["file"]).with_name("points.xyz"))
        assert points.shape == (ycb.POINTS, 3)
        check_on_surface(points[::50], mesh)
        np.testing.assert_allclose(np.ptp(points, axis=0), mesh.extents, rtol=0.1)


def check_on_surface(points: np.ndarray, mesh: trimesh.Trimesh) -> None:
    a = mesh.triangles[:, 0]
    along = np.einsum("fd,pfd->pf", mesh.face_normals, points[:, None] - a[None])
    assert np.abs(along).min(axis=1).max() < 2e-6


def test_frames_are_listed_by_split_if_an_object_can_be_seen(dataset: Dataset, out: Path) -> None:
    expected: dict[str, list[str]] = {"train": [], "val": [], "test": []}
    for episode, frames, k, stem in frames_of(dataset, out):
        pixels = np.bincount(frames.segmentation[k].ravel())[Label.TARGET :]
        if pixels.max(initial=0) >= ycb.LEAST_PIXELS:
            expected[str(episode.columns["split"])].append("/".join(stem.split("/")[-2:]))
    for split, listed in expected.items():
        assert (out / f"image_sets/{split}.txt").read_text().split() == listed
    assert any(expected.values())


def made_of(path: Path, *ids: str, count: int = 1) -> Dataset:
    """Write a store whose episodes have these objects, ``count`` in each scene."""
    n = len(ids) // count
    config = small_config(clutter={"count": count}, block_size=n)
    prepare_store(path, config, JOINTS, n, {})
    rows = [row for row in make_rows(config, 0, n) if isinstance(row, Episode)]
    changed = []
    for k, row in enumerate(rows):
        own = ids[k * count : (k + 1) * count]
        recipes = tuple(replace(row.spec.objects[0], object_id=name) for name in own)
        columns: dict[str, Any] = {"object_ids": np.array(own), "object_id": own[0]}
        columns["object_rest_pose"] = np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0], (count, 1))
        spec = replace(row.spec, objects=recipes)
        changed.append(replace(row, spec=spec, columns={**row.columns, **columns}))
    ZarrWriter(path).write_block(0, changed)
    return Dataset(path)


def test_a_scene_with_an_object_twice_is_excluded(tmp_path: Path) -> None:
    box, ring = "procedural/box/1", "procedural/ring/1"
    dataset = made_of(tmp_path / "store.zarr", box, ring, box, box, ring, box, count=2)
    found = dataset.export("ycb", tmp_path / "out")
    assert found.excluded == {ycb.TWICE: 1}
    assert classes(found.path) == {box: 1, ring: 2}


def test_more_classes_than_a_label_image_can_hold_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ycb, "MOST_CLASSES", 2)
    dataset = made_of(tmp_path / "store.zarr", *(f"procedural/box/{k}" for k in (1, 2, 1, 3)))
    with pytest.raises(UsageError, match=r"^ycb: got 3 different objects, valid: up to 2, .* bop$"):
        dataset.export("ycb", tmp_path / "out")
    assert dataset.export("ycb", tmp_path / "out", [0, 1, 2]).episodes == 3


@pytest.mark.parametrize(
    ("family", "name"),
    [
        ("mug", "007_mug"),
        ("../a b.c", "007_a_b_c"),
        ("\U0001f600", "007_object"),
        ("Tea Pot" * 20, "007_tea_pottea_pottea_pottea_pottea_pottea_p"),
    ],
)
def test_any_family_makes_a_plain_name_of_a_folder(
    dataset: Dataset, family: str, name: str
) -> None:
    assert ycb.class_name(7, replace(dataset.spec(0).objects[0], family=family)) == name
