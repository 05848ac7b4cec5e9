"""The format `bop`, read with json, OpenCV and trimesh."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from support.fake_episodes import JOINTS, make_rows, small_config
from support.silhouettes import distance_outside, silhouette
from support.stored import varied

from grasp_factory.core.enums import Label
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import pose_matrices
from grasp_factory.core.triangle_mesh import TriangleMesh
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.bop import scene_targets
from grasp_factory.writers.exporters.bop_scene import SceneModels, info_row
from grasp_factory.writers.exporters.object_models import NumberedModel, key_of
from grasp_factory.writers.exporters.object_views import ObjectView
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

TIMES = ("before", "after")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def out(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset.export("bop", tmp_path_factory.mktemp("exports") / "out").path


def read_json(path: Path) -> Any:
    return json.loads(path.read_text())


def scenes(dataset: Dataset, out: Path) -> list[tuple[Episode, Path]]:
    return [
        (episode, out / str(episode.columns["split"]) / f"{place:06d}")
        for place, episode in enumerate(dataset)
    ]


def models(out: Path) -> dict[int, trimesh.Trimesh]:
    return {
        row["number"]: trimesh.load(out / row["file"], process=False)
        for row in read_json(out / "objects.json")
    }


def image(folder: Path, name: str) -> np.ndarray:
    read = cv2.imread(str(folder / f"{name}.png"), cv2.IMREAD_UNCHANGED)
    assert read is not None
    return read[..., ::-1] if read.ndim == 3 else read


def test_every_image_camera_and_mask_is_read_back(dataset: Dataset, out: Path) -> None:
    for episode, scene in scenes(dataset, out):
        cameras = read_json(scene / "scene_camera.json")
        assert list(cameras) == [str(i) for i in range(4)]
        for i, row in enumerate(cameras.values()):
            frames, k = episode.cameras[row["camera"]], TIMES.index(row["time"])
            np.testing.assert_array_equal(image(scene, f"rgb/{i:06d}"), frames.rgb[k])
            depth = image(scene, f"depth/{i:06d}")
            assert depth.dtype == np.uint16
            metres = depth * row["depth_scale"] / 1000.0
            assert np.abs(metres - frames.depth[k]).max() <= 0.00005 + 1e-6
            np.testing.assert_array_equal(np.reshape(row["cam_K"], (3, 3)), frames.intrinsics)
            T = np.eye(4)
            T[:3, :3] = np.reshape(row["cam_R_w2c"], (3, 3))
            T[:3, 3] = np.array(row["cam_t_w2c"]) / 1000.0
            np.testing.assert_allclose(T @ frames.T_world_camera[k], np.eye(4), atol=1e-12)
            for m, info in enumerate(read_json(scene / "scene_gt_info.json")[str(i)]):
                seen = frames.segmentation[k] == Label.TARGET + m
                mask = image(scene, f"mask_visib/{i:06d}_{m:06d}")
                np.testing.assert_array_equal(mask, 255 * seen.astype(np.uint8))
                check_info(info, seen, depth)
                x, y, width, height = info["bbox_obj"]
                is_within = 0 <= x <= x + width < 95 and 0 <= y <= y + height < 71
                if is_within:
                    off = 1.0 / info["px_count_all"]
                    assert info["visib_fract"] == pytest.approx(frames.visibility[k, m], abs=off)
                else:
                    assert info["visib_fract"] <= frames.visibility[k, m]


def check_info(info: dict[str, Any], seen: np.ndarray, depth: np.ndarray) -> None:
    """Compare an entry of scene_gt_info.json with the visible mask and the depth image."""
    assert info["px_count_visib"] == seen.sum()
    assert info["px_count_valid"] == np.count_nonzero(seen & (depth > 0))
    assert seen.sum() <= info["px_count_all"]
    if not seen.any():
        assert info["bbox_visib"] == [-1, -1, -1, -1]
        return
    assert info["visib_fract"] == info["px_count_visib"] / info["px_count_all"]
    rows, columns = np.nonzero(seen)
    x, y, width, height = info["bbox_visib"]
    assert (x, x + width) == (columns.min(), columns.max())
    assert (y, y + height) == (rows.min(), rows.max())


def test_every_pose_is_that_of_the_store_about_the_model_s_centre(
    dataset: Dataset, out: Path
) -> None:
    numbers = {row["number"]: row for row in read_json(out / "objects.json")}
    for episode, scene in scenes(dataset, out):
        ends = (episode.columns["object_rest_pose"], episode.streams["object_pose"][-1])
        cameras = read_json(scene / "scene_camera.json")
        for i, rows in read_json(scene / "scene_gt.json").items():
            assert len(rows) == len(episode.spec.objects)
            for m, (row, recipe) in enumerate(zip(rows, episode.spec.objects, strict=True)):
                assert numbers[row["obj_id"]]["object_id"] == recipe.object_id
                frames = episode.cameras[cameras[i]["camera"]]
                k = TIMES.index(cameras[i]["time"])
                T = np.linalg.inv(frames.T_world_camera[k]) @ pose_matrices(ends[k][m])
                R = np.reshape(row["cam_R_m2c"], (3, 3))
                np.testing.assert_allclose(R, T[:3, :3], atol=1e-9)
                center = dataset.object_mesh(recipe).center
                expected = 1000.0 * (T @ [*center, 1.0])[:3]
                np.testing.assert_allclose(row["cam_t_m2c"], expected, atol=1e-6)


def test_models_in_their_poses_cover_what_the_cameras_saw(dataset: Dataset, out: Path) -> None:
    meshes, compared = models(out), 0
    for _, scene in scenes(dataset, out):
        cameras, infos = (read_json(scene / f"scene_{n}.json") for n in ("camera", "gt_info"))
        for i, rows in read_json(scene / "scene_gt.json").items():
            K = np.reshape(cameras[i]["cam_K"], (3, 3))
            for m, (row, info) in enumerate(zip(rows, infos[i], strict=True)):
                mesh = meshes[row["obj_id"]]
                R, t = np.reshape(row["cam_R_m2c"], (3, 3)), np.array(row["cam_t_m2c"])
                seen = image(scene, f"mask_visib/{int(i):06d}_{m:06d}") > 0
                whole = silhouette(mesh.vertices @ R.T + t, mesh.faces, K, seen.shape)
                assert distance_outside(seen, whole) <= 1.5
                if info["visib_fract"] == 1.0:
                    assert distance_outside(whole, seen) <= 1.5
                    compared += 1
                x, y, width, height = cv2.boundingRect(whole.astype(np.uint8))
                box = np.array(info["bbox_obj"])
                if whole.any() and x > 0 and y > 0 and whole[-1].sum() + whole[:, -1].sum() == 0:
                    np.testing.assert_allclose(box, [x, y, width - 1, height - 1], atol=2)
    assert compared >= 4


def test_models_are_centred_closed_surfaces_in_millimetres(dataset: Dataset, out: Path) -> None:
    infos = read_json(out / "models/models_info.json")
    rows = read_json(out / "objects.json")
    recipes = {r.object_id: r for episode in dataset for r in episode.spec.objects}
    assert (
        [row["number"] for row in rows]
        == [int(n) for n in infos]
        == [1 + i for i in range(len(recipes))]
    )
    assert {path.name for path in (out / "models").iterdir()} == {
        "models_info.json",
        *(Path(row["file"]).name for row in rows),
    }
    for row in rows:
        mesh, info = trimesh.load(out / row["file"], process=False), infos[str(row["number"])]
        own = dataset.object_mesh(recipes[row["object_id"]])
        np.testing.assert_array_equal(mesh.faces, own.faces)
        expected = 1000.0 * (own.vertices - own.center)
        np.testing.assert_allclose(mesh.vertices, expected, atol=6e-5 + 1e-5)
        low, size = ([info[f"{w}_{a}"] for a in "xyz"] for w in ("min", "size"))
        np.testing.assert_allclose(mesh.bounds, [low, np.add(low, size)], atol=1e-3)
        np.testing.assert_allclose(mesh.bounds.sum(axis=0), 0.0, atol=1e-3)
        spread = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2)
        assert info["diameter"] == pytest.approx(spread.max(), abs=1e-3)
        assert {k: row[k] for k in ("object_set", "family", "split", "scale")} == {
            k: getattr(recipes[row["object_id"]], k)
            for k in ("object_set", "family", "split", "scale")
        }


def test_the_normals_of_a_model_point_outwards(dataset: Dataset, out: Path) -> None:
    for row in read_json(out / "objects.json"):
        mesh = trimesh.load(out / row["file"], process=False)
        lines = (out / row["file"]).read_text().splitlines()
        start = lines.index("end_header") + 1
        normals = np.array(
            [line.split()[3:6] for line in lines[start:][: len(mesh.vertices)]], float
        )
        if not mesh.is_watertight:
            continue
        assert mesh.volume > 0
        mean = np.einsum("ij,ij->i", normals, mesh.vertex_normals)
        assert (mean > 0.5).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-3)


def test_the_camera_file_is_that_of_the_first_image(dataset: Dataset, out: Path) -> None:
    frames = dataset[0].cameras["front"]
    found = read_json(out / "camera.json")
    height, width = frames.depth.shape[1:]
    assert (found["width"], found["height"], found["depth_scale"]) == (width, height, 0.1)
    K = frames.intrinsics
    expected = [K[0, 0], K[1, 1], K[0, 2], K[1, 2]]
    assert [found[key] for key in ("fx", "fy", "cx", "cy")] == expected


def test_targets_are_the_objects_of_which_a_tenth_is_seen() -> None:
    found = {3: [(7, {"visib_fract": f}) for f in (0.5, 0.09, 0.1)] + [(2, {"visib_fract": 1.0})]}
    assert list(scene_targets(9, found)) == [
        {"im_id": 3, "inst_count": 1, "obj_id": 2, "scene_id": 9},
        {"im_id": 3, "inst_count": 2, "obj_id": 7, "scene_id": 9},
    ]


def test_targets_are_listed_for_the_test_split_only(dataset: Dataset, out: Path) -> None:
    tests = {place for place, e in enumerate(dataset) if e.columns["split"] == "test"}
    found = read_json(out / "test_targets_bop19.json")
    assert {row["scene_id"] for row in found} == tests


def seen_by(T: np.ndarray, visible: np.ndarray, visibility: float) -> dict[str, Any]:
    """Return the entry of a cube of 20 cm for a camera of 40 x 30 pixels."""
    vertices = np.array(list(itertools.product((-0.1, 0.1), repeat=3)))
    mesh = TriangleMesh(vertices=vertices, faces=np.array(trimesh.creation.box().faces))
    dataset = Dataset(varied())
    recipe = dataset.spec(0).objects[0]
    numbers = {key_of(recipe): NumberedModel(number=1, first=0)}
    models = SceneModels(numbers=numbers, meshes={key_of(recipe): mesh})
    frames = dataset[0].cameras["front"]
    frames.intrinsics[:] = [[100.0, 0.0, 20.0], [0.0, 100.0, 15.0], [0.0, 0.0, 1.0]]
    view = ObjectView(recipe=recipe, T_camera_object=T, mask=visible, visibility=visibility)
    return info_row(view, models, frames, np.ones((30, 40), np.uint16))


def at(x: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = (x, 0.0, z)
    return T


def test_an_object_that_is_cut_by_the_image_counts_as_a_whole() -> None:
    mask = np.zeros((30, 40), bool)
    mask[5:26, :11] = True  # of a cube whose front is 1 m away, and whose right side is seen
    found = seen_by(at(-0.2, 1.1), mask, 1.0)
    assert found["px_count_visib"] == 21 * 11
    assert found["px_count_all"] == pytest.approx(21 * 21, rel=0.1)
    assert found["visib_fract"] == pytest.approx(0.5, abs=0.06)
    assert found["bbox_obj"] == [-10, 5, 22, 20]
    assert found["bbox_visib"] == [0, 5, 10, 20]


def test_an_object_of_which_nothing_is_visible_has_pixels_and_no_box() -> None:
    found = seen_by(at(0.0, 1.1), np.zeros((30, 40), bool), 0.0)
    assert found["px_count_all"] == pytest.approx(21 * 21, rel=0.1)
    assert (found["visib_fract"], found["px_count_visib"]) == (0.0, 0)
    assert found["bbox_obj"] == found["bbox_visib"] == [-1, -1, -1, -1]


def test_a_model_that_reaches_behind_the_camera_has_no_box() -> None:
    mask = np.ones((30, 40), bool)
    found = seen_by(at(0.0, 0.05), mask, 0.5)
    assert found["bbox_obj"] == [-1, -1, -1, -1]
    assert found["px_count_all"] == 2 * mask.size


def test_an_object_without_a_finite_pose_is_not_in_that_image(tmp_path: Path) -> None:
    config = small_config(clutter={"count": 2})
    prepare_store(tmp_path / "store.zarr", config, JOINTS, 4, {})
    ZarrWriter(tmp_path / "store.zarr").write_block(0, make_rows(config, 0, 4))
    dataset = Dataset(tmp_path / "store.zarr")
    out = dataset.export("bop", tmp_path / "out").path
    counts = []
    for episode, scene in scenes(dataset, out):
        poses = episode.columns["object_rest_pose"]
        counts.append(int(np.isfinite(poses).all(axis=1).sum()))
        assert len(read_json(scene / "scene_gt.json")["0"]) == counts[-1]
    assert min(counts) < 2 < sum(counts)


@pytest.mark.parametrize("x", [1e5, 1e300])
def test_an_object_that_is_absurdly_far_has_no_box(x: float) -> None:
    found = seen_by(at(x, 0.11), np.ones((30, 40), bool), 1.0)
    assert found["bbox_obj"] == [-1, -1, -1, -1]
    assert found["px_count_all"] == 1200


def test_an_object_of_another_scale_is_another_model(tmp_path: Path) -> None:
    config = small_config()
    prepare_store(tmp_path / "store.zarr", config, JOINTS, 4, {})
    rows = [row for row in make_rows(config, 0, 4) if isinstance(row, Episode)]
    scaled = []
    for row, scale in zip(rows, (1.0, 2.0, 1.0, 2.0), strict=True):
        recipe = replace(rows[0].spec.objects[0], scale=scale)
        scaled.append(replace(row, spec=replace(row.spec, objects=(recipe,))))
    ZarrWriter(tmp_path / "store.zarr").write_block(0, scaled)
    out = Dataset(tmp_path / "store.zarr").export("bop", tmp_path / "out").path
    assert [row["scale"] for row in read_json(out / "objects.json")] == [1.0, 2.0]
    small, large = (mesh.extents for mesh in models(out).values())
    np.testing.assert_allclose(large, 2.0 * small, atol=1e-3)
