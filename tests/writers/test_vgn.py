"""The format ``vgn``, read as VGN and GIGA read it."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.fake_episodes import JOINTS
from support.places import TINY
from support.seen_from_above import CONFIG, PLACE, seen_episode, store_of

from grasp_factory.core.camera import deproject
from grasp_factory.core.enums import Outcome
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, Pose, apply, matrix_to_quat_xyzw
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UnknownNameError, UsageError
from grasp_factory.robots import ROBOTS
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

SIZE, VOXELS = 0.3, 40
FINGER = SIZE / 6
GRIPPER = ROBOTS[CONFIG.robot].gripper
CORNER = np.array([0.55 - SIZE / 2, -SIZE / 2, -FINGER])
"""Of the cube in the world, about the default workspace."""


def table_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "grasps.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def numbers(row: dict[str, str], names: str) -> Array:
    return np.array([float(row[name]) for name in names.split()])


def pose(row: dict[str, str]) -> Array:
    """Return the pose of the grasp in the cube, (4, 4), as VGN's read_grasp does."""
    quat, place = numbers(row, "qx qy qz qw").tolist(), numbers(row, "x y z").tolist()
    return Pose(tuple(place), tuple(quat)).matrix()


def scene(folder: Path, row: dict[str, str]) -> dict[str, NDArray[Any]]:
    with np.load(folder / "scenes" / f"{row['scene_id']}.npz", allow_pickle=False) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("yaw", [0.0, 0.7, -1.3])
def test_the_ends_of_vgns_fingers_are_those_of_the_gripper(tmp_path: Path, yaw: float) -> None:
    dataset = store_of(tmp_path / "store.zarr", [seen_episode(yaw)])
    dataset.export("vgn", tmp_path / "out")
    (row,) = table_of(tmp_path / "out" / "raw")
    width = float(row["width"])
    # src/vgn/vis.py draws fingers from the origin along z, finger_depth long, at y = +-width / 2.
    ends = np.array([[0.0, side * width / 2, FINGER] for side in (-1, 1)])
    in_world = apply(pose(row), ends) + CORNER
    tips = np.array(PLACE) + np.array([0.0, 0.0, -GRIPPER.tip_distance])
    np.testing.assert_allclose(in_world.mean(axis=0), tips, atol=1e-9)
    # The gripper closes along the world's -y, turned by yaw about the vertical.
    closing = (in_world[1] - in_world[0]) / width
    np.testing.assert_allclose(closing, [np.sin(yaw), -np.cos(yaw), 0.0], atol=1e-9)
    np.testing.assert_allclose(pose(row)[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)


def test_a_simulated_store_is_read_back(tmp_path: Path) -> None:
    dataset, out = Dataset(TINY), tmp_path / "out"
    found = dataset.export("vgn", out)
    assert (found.episodes, found.excluded) == (len(dataset), {})
    raw, training = table_of(out / "raw"), table_of(out / "training")
    setup = json.loads((out / "raw" / "setup.json").read_text())
    assert (setup["size"], setup["finger_depth"]) == (SIZE, FINGER)
    assert setup["max_opening_width"] == GRIPPER.max_width
    for row, voxels, episode in zip(raw, training, dataset, strict=True):
        frames, columns = episode.cameras["front"], episode.columns
        images = scene(out / "raw", row)
        np.testing.assert_array_equal(images["depth_imgs"], frames.depth[:1])
        assert images["depth_imgs"].dtype == np.float32
        np.testing.assert_allclose(setup["intrinsic"]["K"], frames.intrinsics.ravel(), rtol=1e-12)
        quat, place = np.split(images["extrinsics"][0], [4])
        T_camera_cube = Pose(tuple(place.tolist()), tuple(quat.tolist())).matrix()
        np.testing.assert_allclose(
            frames.T_world_camera[0] @ T_camera_cube @ [0.0, 0.0, 0.0, 1.0],
            [*CORNER, 1.0],
            atol=1e-9,
        )
        np.testing.assert_allclose(numbers(row, "qx qy qz qw"), columns["grasp_quat_xyzw"])
        tcp = apply(pose(row), np.array([0.0, 0.0, FINGER - GRIPPER.tip_distance]))
        np.testing.assert_allclose(tcp + CORNER, columns["grasp_position"], atol=1e-9)
        assert int(row["label"]) == int(voxels["label"]) == episode.success
        held = float(episode.streams["gripper_width"][-1])
        assert float(row["width"]) == (held if episode.success else GRIPPER.max_width)
        assert voxels["scene_id"] == row["scene_id"]
        in_voxels = numbers(voxels, "i j k width") * SIZE / VOXELS
        np.testing.assert_allclose(in_voxels, numbers(row, "x y z width"), rtol=1e-12)
        assert (np.round(numbers(voxels, "i j k")) < VOXELS).all()
        check_grid(scene(out / "training", voxels)["grid"], frames.depth[0], setup, T_camera_cube)


def check_grid(
    grid: NDArray[Any], depth: NDArray[Any], setup: dict[str, Any], T_camera_cube: Array
) -> None:
    """Check that the surface that the depth image shows is where the grid has it."""
    assert (grid.shape, grid.dtype) == ((1, VOXELS, VOXELS, VOXELS), np.float32)
    K = np.array(setup["intrinsic"]["K"]).reshape(3, 3)
    points = apply(np.linalg.inv(T_camera_cube), deproject(depth.astype(float), K))
    at = np.floor(points / (SIZE / VOXELS)).astype(int)
    inside = ((at >= 0) & (at < VOXELS)).all(axis=-1)
    values = grid[0][tuple(at[inside].T)]
    assert inside.sum() > 500
    assert np.median(np.abs(values[values > 0] - 0.5)) < 0.1
    assert (values > 0).mean() > 0.95


def test_the_columns_have_vgns_names_and_no_scene_looks_like_a_number(tmp_path: Path) -> None:
    store_of(tmp_path / "store.zarr", [seen_episode()]).export("vgn", tmp_path / "out")
    for folder, place in (("raw", "x y z"), ("training", "i j k")):
        (row,) = table_of(tmp_path / "out" / folder)
        assert list(row) == f"scene_id qx qy qz qw {place} width label".split()
        with pytest.raises(ValueError, match="could not convert"):
            float(row["scene_id"])  # pandas would drop the zeros of a number


def test_the_width_of_a_success_is_that_of_the_held_object(tmp_path: Path) -> None:
    def with_last_width(index: int, width: float) -> Episode:
        episode = seen_episode(index=index)
        widths = np.array([0.1, 0.08, 0.05, width], np.float32)
        return dataclasses.replace(episode, streams={**episode.streams, "gripper_width": widths})

    held, lost, unknown = (
        with_last_width(k, width) for k, width in enumerate((0.04, 0.04, np.nan))
    )
    lost = dataclasses.replace(lost, outcome=Outcome.LOST_IN_LIFT)
    store_of(tmp_path / "store.zarr", [held, lost, unknown]).export("vgn", tmp_path / "out")
    table = table_of(tmp_path / "out" / "raw")
    widths = [float(row["width"]) for row in table]
    assert widths == [float(np.float32(0.04)), GRIPPER.max_width, GRIPPER.max_width]
    assert [row["label"] for row in table] == ["1", "0", "1"]


def test_grasps_outside_the_cube_and_no_grasps_are_left_out_and_counted(tmp_path: Path) -> None:
    side = 0.55 + SIZE / 2
    episodes = [
        seen_episode(),
        seen_episode(index=1, grasp_position=np.array([side + 0.01, 0.0, 0.05])),
        seen_episode(index=2, grasp_position=np.array([np.nan, 0.0, 0.05])),
        seen_episode(index=3, grasp_position=np.array([side - 0.01, 0.0, 0.05])),
    ]
    dataset, out = store_of(tmp_path / "store.zarr", episodes), tmp_path / "out"
    found = dataset.export("vgn", out)
    reasons = {"no grasp was planned": 1, "the grasp is outside the cube": 1}
    assert (found.episodes, found.excluded) == (2, reasons)
    found = dataset.export("vgn", tmp_path / "larger", size=0.36)
    assert (found.episodes, found.excluded) == (3, {"no grasp was planned": 1})
    setup = json.loads((tmp_path / "larger" / "raw" / "setup.json").read_text())
    assert setup["size"] == pytest.approx(6 * setup["finger_depth"])


def test_a_tilted_grasp_keeps_its_fingertips(tmp_path: Path) -> None:
    R = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # approaches along +x
    episode = seen_episode(grasp_quat_xyzw=matrix_to_quat_xyzw(R))
    store_of(tmp_path / "store.zarr", [episode]).export("vgn", tmp_path / "out")
    (row,) = table_of(tmp_path / "out" / "raw")
    tip = apply(pose(row), np.array([0.0, 0.0, FINGER])) + CORNER
    np.testing.assert_allclose(tip, (PLACE[0] + GRIPPER.tip_distance, *PLACE[1:]), atol=1e-9)


def test_images_of_cameras_with_other_lenses_get_the_intrinsics_of_the_first(
    tmp_path: Path,
) -> None:
    wider = dataclasses.replace(CONFIG.cameras["front"], fov_y_deg=60.0)
    config = dataclasses.replace(CONFIG, cameras={**CONFIG.cameras, "front": wider})
    episode = seen_episode(cameras=config.cameras)
    prepare_store(tmp_path / "store.zarr", config, JOINTS, 1, {})
    ZarrWriter(tmp_path / "store.zarr").write_block(0, [episode])
    dataset, out = Dataset(tmp_path / "store.zarr"), tmp_path / "out"
    dataset.export("vgn", out, cameras=["overhead", "front"])
    images = scene(out / "raw", table_of(out / "raw")[0])["depth_imgs"]
    K = np.array(json.loads((out / "raw" / "setup.json").read_text())["intrinsic"]["K"])
    K = K.reshape(3, 3)
    frames = dataset[0].cameras
    np.testing.assert_allclose(K, frames["overhead"].intrinsics)
    np.testing.assert_array_equal(images[0], frames["overhead"].depth[0])
    front = frames["front"]
    for row, column in ((120, 160), (60, 100), (200, 300)):
        ray = np.linalg.inv(K) @ [column, row, 1.0]
        u, v, _ = np.round(front.intrinsics @ ray).astype(int)
        assert images[1, row, column] == front.depth[0, v, u]


def test_missing_depth_is_0_in_the_images(tmp_path: Path) -> None:
    episode = seen_episode()
    depth = episode.cameras["front"].depth.copy()
    depth[:, 3, 4], depth[:, 5, 6] = np.nan, np.inf
    frames = dataclasses.replace(episode.cameras["front"], depth=depth)
    episode = dataclasses.replace(episode, cameras={**episode.cameras, "front": frames})
    dataset, out = store_of(tmp_path / "store.zarr", [episode]), tmp_path / "out"
    dataset.export("vgn", out, cameras=["front"])
    (image,) = scene(out / "raw", table_of(out / "raw")[0])["depth_imgs"]
    assert (image[3, 4], image[5, 6]) == (0.0, 0.0)
    assert (image == 0.0).sum() == 2


def test_settings_that_are_not_valid_are_refused(tmp_path: Path) -> None:
    dataset = Dataset(TINY)
    with pytest.raises(UnknownNameError, match="unknown camera 'wrst'"):
        dataset.export("vgn", tmp_path / "out", cameras=["wrst"])
    with pytest.raises(ConfigError, match=r"size: got 0.01, valid: 0.1 to 10.0 m"):
        dataset.export("vgn", tmp_path / "out", size=0.01)
    with pytest.raises(UsageError, match="can hold none of 4 episodes"):
        dataset.export("vgn", tmp_path / "out", size=0.1, cameras=["front"])
