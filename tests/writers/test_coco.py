"""The format `coco`, read with pycocotools."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from support.fake_episodes import JOINTS, make_rows, small_config
from support.stored import old_store, varied

from grasp_factory.core.enums import Label, label_names
from grasp_factory.core.episode import Episode
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.exporting import Exported
from grasp_factory.writers.exporters.grasp_key_points import HIDDEN, VISIBLE, key_points
from grasp_factory.writers.exporters.object_views import NO_SPLIT
from grasp_factory.writers.exporters.run_length import run_length
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

# pycocotools 2.0.11 was written for NumPy 1.
pytestmark = pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def out(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset.export("coco", tmp_path_factory.mktemp("exports") / "out").path


def read(path: Path) -> COCO:
    with contextlib.redirect_stdout(io.StringIO()):
        return COCO(str(path))


def images(out: Path) -> Iterator[tuple[COCO, dict[str, Any], Path]]:
    for path in sorted((out / "annotations").iterdir()):
        coco = read(path)
        split = path.stem.removeprefix("instances_")
        for row in coco.loadImgs(coco.getImgIds()):
            yield coco, row, out / "images" / split / row["file_name"]


def test_every_image_and_mask_is_read_back(dataset: Dataset, out: Path) -> None:
    seen, numbers = set(), list[int]()
    for coco, row, path in images(out):
        episode = dataset[row["episode"]]
        frames, k = episode.cameras[row["camera"]], ("before", "after").index(row["time"])
        seen.add((row["episode"], row["camera"], k))
        assert path.parent.name == episode.columns["split"]
        np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], frames.rgb[k])
        assert (row["height"], row["width"]) == frames.depth.shape[1:]
        np.testing.assert_array_equal(row["K"], frames.intrinsics)
        np.testing.assert_array_equal(row["T_world_camera"], frames.T_world_camera[k])
        assert (row["success"], row["outcome"]) == (episode.success, episode.outcome.name.lower())
        labels = np.zeros(frames.segmentation[k].shape, np.uint8)
        for annotation in coco.loadAnns(coco.getAnnIds(row["id"])):
            check_annotation(coco, annotation, episode, row, labels)
            numbers.append(annotation["id"])
        whole = frames.segmentation[k]
        np.testing.assert_array_equal(labels, np.where(whole >= Label.ARM, whole, 0))
    assert len(seen) == len(dataset.committed) * 2 * 2
    assert len(set(numbers)) == len(numbers)
    assert min(numbers) > 0
    assert len(list((out / "images").rglob("*.png"))) == len(seen)


def check_annotation(
    coco: COCO, row: dict[str, Any], episode: Episode, image: dict[str, Any], labels: np.ndarray
) -> None:
    """Compare an annotation with its mask, and add the mask to the image of labels."""
    mask = coco.annToMask(row).astype(bool)
    words = label_names(len(episode.spec.objects))
    label = words.index(row["attributes"]["label"])
    assert not labels[mask].any()
    labels[mask] = label
    assert row["area"] == mask.sum() == coco_mask.area(row["segmentation"])
    np.testing.assert_array_equal(row["bbox"], coco_mask.toBbox(row["segmentation"]))
    category = coco.cats[row["category_id"]]
    if label < Label.TARGET:
        assert (category["supercategory"], category["name"]) == ("robot", words[label])
        return
    m, k = label - Label.TARGET, ("before", "after").index(image["time"])
    assert (category["supercategory"], category["name"]) == (
        "object",
        episode.spec.objects[m].family,
    )
    attributes = row["attributes"]
    assert attributes["object_id"] == episode.spec.objects[m].object_id
    assert attributes["visibility"] == episode.cameras[image["camera"]].visibility[k, m]
    assert attributes.get("success") == (episode.success if m == 0 else None)
    assert any(row["keypoints"]) == bool(row["num_keypoints"])
    if m or k:
        assert row["num_keypoints"] == 0


def test_the_key_points_are_the_grasp_in_the_image(dataset: Dataset, out: Path) -> None:
    compared = 0
    for coco, row, _ in images(out):
        for annotation in coco.loadAnns(coco.getAnnIds(row["id"])):
            if not annotation.get("num_keypoints"):
                continue
            columns = dataset[row["episode"]].columns
            K, T = np.array(row["K"]), np.linalg.inv(row["T_world_camera"])
            xyv = np.array(annotation["keypoints"]).reshape(-1, 3)
            tcp = K @ (T @ [*columns["grasp_position"], 1.0])[:3]
            np.testing.assert_allclose(xyv[0, :2], tcp[:2] / tcp[2], atol=1e-9)
            x, y, z, w = columns["grasp_quat_xyzw"]
            closing = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
            for point, side in ((xyv[1], -0.5), (xyv[2], 0.5)):
                end = columns["grasp_position"] + side * columns["grasp_width"] * closing
                found = K @ (T @ [*end, 1.0])[:3]
                if point[2]:
                    np.testing.assert_allclose(point[:2], found[:2] / found[2], atol=1e-9)
            compared += 1
    assert compared >= 2


def seen_from_above(episode: Episode, depth: float, **columns: Any) -> list[float]:
    """Return the key points for a camera 1 m above the origin that measures one depth."""
    frames = episode.cameras["front"]
    height, width = frames.depth.shape[1:]
    frames.depth[:] = depth
    frames.intrinsics[:] = [[50.0, 0.0, width / 2], [0.0, 50.0, height / 2], [0.0, 0.0, 1.0]]
    frames.T_world_camera[:] = np.diag([1.0, -1.0, -1.0, 1.0])
    frames.T_world_camera[:, 2, 3] = 1.0
    grasp = {
        "grasp_position": np.zeros(3),
        "grasp_quat_xyzw": np.array([1.0, 0.0, 0.0, 0.0]),
        "grasp_width": 0.08,
    }
    episode.columns.update(grasp | columns)  # type: ignore[attr-defined]
    return key_points(episode, frames)


def test_a_key_point_is_hidden_behind_what_is_nearer(dataset: Dataset) -> None:
    for depth, visibility in ((0.9, HIDDEN), (1.1, VISIBLE)):
        found = seen_from_above(dataset[0], depth)
        np.testing.assert_allclose(
            found, [48, 36, visibility, 48, 34, visibility, 48, 38, visibility]
        )


@pytest.mark.parametrize(
    "position",
    [[np.nan] * 3, [0.0, 0.0, 2.0], [5.0, 0.0, 0.0]],
    ids=["no grasp", "behind the camera", "outside the image"],
)
def test_what_cannot_be_seen_is_not_labelled(dataset: Dataset, position: list[float]) -> None:
    found = seen_from_above(dataset[0], 2.0, grasp_position=np.array(position))
    assert found == [0.0] * 9


def test_coco_s_own_evaluation_gives_the_truth_full_marks(out: Path) -> None:
    for path in (out / "annotations").iterdir():
        coco = read(path)
        truth = coco.loadAnns(coco.getAnnIds())
        keys = ("image_id", "category_id", "segmentation")
        with contextlib.redirect_stdout(io.StringIO()):
            results = coco.loadRes([{key: a[key] for key in keys} | {"score": 1} for a in truth])
            evaluation = COCOeval(coco, results, "segm")
            evaluation.evaluate()
            evaluation.accumulate()
            evaluation.summarize()
        assert evaluation.stats[0] == pytest.approx(1.0)


def masks() -> Iterator[np.ndarray]:
    yield from (np.full((3, 5), value) for value in (False, True))
    yield np.eye(7, dtype=bool)
    rng = np.random.default_rng(0)
    for share in np.linspace(0.01, 0.99, 40):
        shape = rng.integers(1, 300, 2)
        smooth = cv2.blur(rng.random(shape).astype(np.float32), (5, 5))
        yield smooth < np.quantile(smooth, share)


def test_run_lengths_are_those_of_pycocotools() -> None:
    for mask in masks():
        found = run_length(mask)
        expected = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
        assert found == {"size": expected["size"], "counts": expected["counts"].decode()}


def test_any_family_is_a_category_and_in_no_file_name(tmp_path: Path) -> None:
    family = '../a/b.c "\U0001f600'
    found = export_fake(tmp_path, lambda row: with_family(row, family))
    names = {path.name for path in found.path.rglob("*")}
    assert all(name.isascii() and '"' not in name for name in names)
    for path in (found.path / "annotations").iterdir():
        assert [c["name"] for c in read(path).cats.values()] == ["arm", "gripper", family]


def with_family(row: Episode, family: str) -> Episode:
    recipes = tuple(replace(recipe, family=family) for recipe in row.spec.objects)
    return replace(row, spec=replace(row.spec, objects=recipes))


def with_split(row: Episode, split: str) -> Episode:
    return replace(row, columns={**row.columns, "split": split})


def export_fake(folder: Path, change: Callable[[Episode], Episode]) -> Exported:
    """Export a store whose rows are changed before they are written."""
    config = small_config()
    prepare_store(folder / "store.zarr", config, JOINTS, 4, {})
    rows = [row for row in make_rows(config, 0, 4) if isinstance(row, Episode)]
    rows = [change(row) for row in rows]
    ZarrWriter(folder / "store.zarr").write_block(0, rows)
    return Dataset(folder / "store.zarr").export("coco", folder / "out")


def test_an_episode_of_an_unknown_split_is_excluded(tmp_path: Path) -> None:
    found = export_fake(
        tmp_path, lambda row: with_split(row, "../../escaped") if row.spec.index == 2 else row
    )
    assert found.excluded == {NO_SPLIT: 1}
    assert {path.name for path in tmp_path.iterdir()} == {"store.zarr", "out"}
    assert {path.name for path in (found.path / "images").iterdir()} <= {"train", "val", "test"}


def test_a_store_of_an_older_version_is_exported(tmp_path: Path) -> None:
    assert Dataset(old_store(tmp_path)).export("coco", tmp_path / "out").episodes == 3
