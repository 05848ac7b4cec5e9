"""The format ``gqcnn``, read as autolab_core's TensorDataset reads it."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from support.places import TINY
from support.seen_from_above import PLACE, WIDTH, seen_episode, store_of
from support.views import BRICK

from grasp_factory.core.camera import project
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import apply, inverse, quat_xyzw_to_matrix
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError

Tensors = dict[str, NDArray[Any]]


def read_tensors(out: Path) -> Tensors:
    """Return all values of each field, as TensorDataset finds them."""
    config = json.loads((out / "config.json").read_text())
    tensors = {}
    for name, field in config["fields"].items():
        shape = tuple(field[key] for key in ("height", "width", "channels") if key in field)
        parts = []
        for path in sorted((out / "tensors").glob(f"{name}_[0-9]*.npz")):
            assert path.name == f"{name}_{len(parts):05d}.npz"
            with np.load(path, allow_pickle=False) as file:
                parts.append(file["arr_0"])
        assert {part.shape[1:] for part in parts} == {shape}
        assert all(len(part) == config["datapoints_per_file"] for part in parts[:-1])
        assert {part.dtype for part in parts} == {np.dtype(field["dtype"])}
        tensors[name] = np.concatenate(parts)
    return tensors


def one(tmp_path: Path, episode: Episode, **settings: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the image (S, S) and the pose (7,) of an episode."""
    store_of(tmp_path / "store.zarr", [episode]).export("gqcnn", tmp_path / "out", **settings)
    tensors = read_tensors(tmp_path / "out")
    return tensors["tf_depth_ims"][0, :, :, 0], tensors["grasps"][0]


@pytest.mark.parametrize("yaw", [0.0, 0.4, 1.2, -0.9, math.pi / 2])
def test_the_gripper_closes_along_the_rows_around_the_middle(tmp_path: Path, yaw: float) -> None:
    image, pose = one(tmp_path, seen_episode(yaw), size=64, extent=0.128)
    metres = 0.128 / 64
    # The grasp closes across the brick, 0.04 m, so its length, 0.10 m, is along the columns.
    on_top = image < image.max() - 0.5 * BRICK[2]
    rows, columns = np.nonzero(on_top)
    assert np.ptp(columns) * metres == pytest.approx(BRICK[1], abs=0.006)
    assert np.ptp(rows) * metres == pytest.approx(BRICK[0], abs=0.008)
    assert rows.mean() == pytest.approx(31.5, abs=1.5)
    assert columns.mean() == pytest.approx(31.5, abs=1.5)
    assert on_top.sum() == pytest.approx(BRICK[0] * BRICK[1] / metres**2, rel=0.1)
    # The camera looks straight down, with the world's x up: yaw turns against the clock.
    assert math.remainder(float(pose[3]) + yaw, math.pi) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("yaw", [0.3, -1.0])
def test_the_crop_is_the_one_that_gqcnn_makes_of_the_whole_image(
    tmp_path: Path, yaw: float
) -> None:
    side, episode = 32, seen_episode(yaw)
    frames = episode.cameras["overhead"]
    rows, columns = frames.depth[0].shape
    numbered = np.arange(1, rows * columns + 1, dtype=np.float32).reshape(rows, columns)
    frames = dataclasses.replace(frames, depth=np.stack([numbered] * 2))
    episode = dataclasses.replace(episode, cameras={**episode.cameras, "overhead": frames})
    height, focal = float(frames.T_world_camera[0, 2, 3]) - PLACE[2], frames.intrinsics[0, 0]
    image, pose = one(tmp_path, episode, size=side, extent=side * height / focal)
    # autolab_core's Image.transform: move the grasp to the middle, then turn about the middle.
    row, column, _, angle = pose[:4].astype(float)
    move = np.array([[1, 0, columns / 2 - column], [0, 1, rows / 2 - row], [0, 0, 1]])
    turn = cv2.getRotationMatrix2D((columns / 2, rows / 2), math.degrees(angle), 1)
    whole = cv2.warpAffine(numbered, turn @ move, (columns, rows), flags=cv2.INTER_NEAREST)
    top, left = rows // 2 - side // 2, columns // 2 - side // 2
    theirs = whole[top : top + side, left : left + side]
    # Their grasp is at a pixel, ours in the middle of four: half a pixel apart along each axis.
    ours, others = (np.array(np.divmod(crop - 1, columns)) for crop in (image, theirs))
    apart = ours - others
    assert np.abs(apart).max() <= 2
    turned = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    wanted = np.array(turned) @ [0.5, 0.5]
    np.testing.assert_allclose(apart.mean(axis=(1, 2)), wanted, atol=0.1)


def test_a_simulated_store_is_read_back(tmp_path: Path) -> None:
    dataset, out = Dataset(TINY), tmp_path / "out"
    dataset.export("gqcnn", out, camera="front", episodes_per_shard=3)
    tensors = read_tensors(out)
    assert len(tensors["grasps"]) == len(dataset)
    for k, episode in enumerate(dataset):
        frames, columns = episode.cameras["front"], episode.columns
        at_camera = apply(inverse(frames.T_world_camera[0]), columns["grasp_position"])
        column, row = project(at_camera, frames.intrinsics)
        found = tensors["grasps"][k].astype(float)
        cy, cx = frames.intrinsics[(1, 0), 2]
        wanted = [row, column, at_camera[2], row - cy, column - cx]
        np.testing.assert_allclose(found[[0, 1, 2, 4, 5]], wanted, rtol=1e-5, atol=1e-4)
        R = quat_xyzw_to_matrix(columns["grasp_quat_xyzw"])
        ends = [
            columns["grasp_position"] + s * R[:, 1] * columns["grasp_width"] / 2 for s in (-1, 1)
        ]
        left, right = project(
            apply(inverse(frames.T_world_camera[0]), np.array(ends)), frames.intrinsics
        )
        assert found[6] == pytest.approx(np.linalg.norm(right - left), rel=1e-5)
        closing = (right - left) / np.linalg.norm(right - left)
        assert abs(closing @ [math.cos(found[3]), math.sin(found[3])]) == pytest.approx(1, abs=1e-6)
        assert tensors["grasp_metrics"][k] == episode.success
        image = tensors["tf_depth_ims"][k]
        assert np.isin(image, np.append(frames.depth[0], np.float32(0.0))).all()
        nearest = frames.depth[0][round(float(row)), round(float(column))]
        assert image[15:17, 15:17, 0].min() <= nearest + 0.01
    split = out / "splits" / "object_wise"
    for name in ("train", "val"):
        with np.load(split / f"{name}_indices.npz") as file:
            wanted = [k for k, e in enumerate(dataset) if e.columns["split"] == name]
            assert file["arr_0"].tolist() == wanted


def test_what_is_beyond_the_image_or_has_no_depth_is_0(tmp_path: Path) -> None:
    episode = seen_episode(grasp_position=np.array([0.55, 0.46, 0.03]))
    image, _ = one(tmp_path, episode, extent=0.3)
    assert 0.2 < (image == 0.0).mean() < 0.8
    assert (image[:, -1] > 0.0).all()
    depth = np.full_like(episode.cameras["overhead"].depth, np.nan)
    blind = dataclasses.replace(episode.cameras["overhead"], depth=depth)
    (tmp_path / "blind").mkdir()
    cameras = {**episode.cameras, "overhead": blind}
    image, _ = one(tmp_path / "blind", dataclasses.replace(episode, cameras=cameras))
    assert not image.any()


def test_a_grasp_behind_the_camera_has_only_its_metric(tmp_path: Path) -> None:
    image, pose = one(tmp_path, seen_episode(grasp_position=np.array([0.55, 0.0, 2.0])))
    assert not image.any()
    assert not pose.any()


def test_failures_have_the_metric_0_and_episodes_without_a_grasp_are_left_out(
    tmp_path: Path,
) -> None:
    episodes = [
        seen_episode(),
        dataclasses.replace(seen_episode(index=1), outcome=Outcome.NO_CONTACT),
        seen_episode(index=2, grasp_width=math.nan),
        seen_episode(index=3),
    ]
    dataset, out = store_of(tmp_path / "store.zarr", episodes), tmp_path / "out"
    found = dataset.export("gqcnn", out, episodes_per_shard=2)
    assert (found.episodes, found.excluded) == (3, {"no grasp was planned": 1})
    tensors = read_tensors(out)
    assert tensors["grasp_metrics"].tolist() == [1.0, 0.0, 1.0]
    assert all(np.isfinite(values).all() for values in tensors.values())
    scale = tensors["grasps"][0, 2] / dataset[0].cameras["overhead"].intrinsics[0, 0]
    np.testing.assert_allclose(tensors["grasps"][:, 6] * scale, WIDTH, rtol=1e-5)


def test_a_store_without_the_overhead_camera_and_wrong_sizes_are_refused(tmp_path: Path) -> None:
    dataset = Dataset(TINY)
    with pytest.raises(UsageError, match="has no camera overhead, and the format needs a view"):
        dataset.export("gqcnn", tmp_path / "out")
    with pytest.raises(ConfigError, match="size: got 7, valid: 8 to 128 pixels"):
        dataset.export("gqcnn", tmp_path / "out", size=7)
