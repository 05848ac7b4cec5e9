"""The format `sequences`, read with csv, json, yaml and OpenCV."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from support.fake_episodes import JOINTS, make_episode, small_config
from support.stored import varied

from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import inverse, pose_matrices
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.csv_series import write_series
from grasp_factory.writers.zarr.store import prepare_store
from grasp_factory.writers.zarr.writer import ZarrWriter

AXES = ("x", "y", "z")
WRENCH = [f"f{axis}" for axis in AXES] + [f"t{axis}" for axis in AXES]
POSE = ["px", "py", "pz", "qx", "qy", "qz", "qw"]


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


@pytest.fixture(scope="module")
def out(dataset: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset.export("sequences", tmp_path_factory.mktemp("exports") / "out").path


def read_csv(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV file; an empty cell is NaN."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def joined(table: dict[str, np.ndarray], names: list[str]) -> np.ndarray:
    return np.stack([table[name] for name in names], axis=1).astype(np.float32)


def each(dataset: Dataset, out: Path) -> list[tuple[Episode, str, Path]]:
    return [
        (episode, camera, out / "sequences" / f"{place:06d}_{camera}")
        for place, episode in enumerate(dataset)
        for camera in episode.cameras
    ]


def test_every_image_is_read_back_at_its_time(dataset: Dataset, out: Path) -> None:
    for episode, camera, folder in each(dataset, out):
        frames = json.loads((folder / "metadata.json").read_text())
        images, videos = episode.cameras[camera], episode.videos
        rgb = np.concatenate([images.rgb[:1], videos[f"{camera}/rgb"], images.rgb[1:]])
        poses = videos[f"{camera}/T_world_camera"]
        poses = np.concatenate([images.T_world_camera[:1], poses, images.T_world_camera[1:]])
        times = [0.0, *videos["timestamp"], episode.streams["timestamp"][-1]]
        assert [frame["frame_id"] for frame in frames] == list(range(len(rgb)))
        assert [frame["timestamp"] for frame in frames] == times
        for frame, image, pose in zip(frames, rgb, poses, strict=True):
            bgr = cv2.imread(str(folder / frame["rgb_path"]))
            np.testing.assert_array_equal(bgr[..., ::-1], image)
            np.testing.assert_array_equal(frame["T_world_camera"], pose)
        assert [bool(frame["depth_path"]) for frame in frames[1:-1]] == [False] * (len(rgb) - 2)
        for k in (0, -1):
            depth = cv2.imread(str(folder / frames[k]["depth_path"]), cv2.IMREAD_UNCHANGED)
            assert depth.dtype == np.uint16
            assert np.abs(depth / 1000.0 - images.depth[k]).max() <= 0.0005 + 1e-6
            labels = cv2.imread(str(folder / frames[k]["segmentation_path"]), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(labels, images.segmentation[k])


def test_every_series_is_read_back_exactly(dataset: Dataset, out: Path) -> None:
    for episode, _, folder in each(dataset, out):
        streams, imu = episode.streams, episode.imu
        tables = {name: read_csv(folder / name / "data.csv") for name in FILES}
        for name in ("force", "tactile", "robot", "objects"):
            np.testing.assert_array_equal(tables[name]["timestamp"], streams["timestamp"])
        np.testing.assert_array_equal(tables["imu"]["timestamp"], imu["timestamp"])
        joints = streams["joint_positions"].shape[1]
        expected: dict[tuple[str, tuple[str, ...]], Any] = {
            ("imu", ("ax", "ay", "az")): imu["specific_force"],
            ("imu", ("wx", "wy", "wz")): imu["angular_velocity"],
            ("force", tuple(WRENCH)): streams["wrist_wrench"],
            **{
                ("tactile", tuple(f"{side}_{name}" for name in WRENCH)): streams["tactile_wrench"][
                    :, k
                ]
                for k, side in enumerate(("left", "right"))
            },
            **{
                ("robot", tuple(f"{JOINTS_IN_CSV[name]}_{k}" for k in range(joints))): streams[name]
                for name in JOINTS_IN_CSV
            },
            **{("robot", (name,)): streams[name][:, None] for name in SCALARS},
            ("robot", tuple(f"tcp_{part}" for part in POSE)): streams["tcp_pose"],
            ("robot", tuple(f"hand_f{axis}" for axis in AXES)): streams["hand_force"],
            **{
                ("objects", tuple(f"object_{k}_{part}" for part in POSE)): poses
                for k, poses in enumerate(streams["object_pose"].swapaxes(0, 1))
            },
        }
        for (name, columns), values in expected.items():
            found = joined(tables[name], list(columns))
            np.testing.assert_array_equal(found, values.astype(np.float32))
        read = sum(len(columns) for _, columns in expected) + 5  # and five clocks
        assert read == sum(len(table) for table in tables.values())


JOINTS_IN_CSV = {
    "joint_positions": "joint_position",
    "joint_velocities": "joint_velocity",
    "joint_torques": "joint_torque",
    "joint_position_targets": "joint_position_target",
}
FILES = ("imu", "force", "tactile", "robot", "objects")
SCALARS = (
    "gripper_width",
    "gripper_width_target",
    "gripper_force",
    "phase",
    "shake_level",
    "reward",
)


def test_the_calibration_is_that_of_the_camera(dataset: Dataset, out: Path) -> None:
    for episode, camera, folder in each(dataset, out):
        images = episode.cameras[camera]
        found = json.loads((folder / "calibration/cam_intrinsics.json").read_text())
        assert (found["width"], found["height"]) == (96, 72)
        np.testing.assert_array_equal(np.reshape(found["K"], (3, 3)), images.intrinsics)
        (kalibr,) = yaml.safe_load(
            (folder / "calibration/imu_to_cam_extrinsics.yaml").read_text()
        ).values()
        fu, fv, pu, pv = kalibr["intrinsics"]
        np.testing.assert_array_equal([[fu, 0, pu], [0, fv, pv], [0, 0, 1]], images.intrinsics)
        assert kalibr["T_cam_imu_is_constant"] is (camera == "wrist")
        # At each video frame the camera on the hand sees the IMU at the same place.
        times, clock = episode.videos["timestamp"], episode.streams["timestamp"]
        records = [int(np.argmin(np.abs(clock - time))) for time in times]
        T_world_tcp = pose_matrices(episode.streams["tcp_pose"][records])
        T_world_camera = episode.videos[f"{camera}/T_world_camera"]
        seen = np.linalg.inv(T_world_camera) @ T_world_tcp @ episode.imu["T_tcp_imu"]
        if camera == "wrist":
            np.testing.assert_allclose(seen, [kalibr["T_cam_imu"]] * len(seen), atol=1e-5)
        else:
            first = pose_matrices(episode.streams["tcp_pose"][0]) @ episode.imu["T_tcp_imu"]
            expected = inverse(images.T_world_camera[0]) @ first
            np.testing.assert_allclose(kalibr["T_cam_imu"], expected, atol=1e-9)


def test_each_frame_has_the_nearest_sample_of_the_imu(dataset: Dataset, out: Path) -> None:
    episode, _, folder = each(dataset, out)[0]
    for frame in json.loads((folder / "sync_metadata.json").read_text()):
        away = np.abs(episode.imu["timestamp"] - frame["timestamp"])
        assert abs(frame["imu"]["timestamp"] - frame["timestamp"]) == away.min()
        k = int(away.argmin())
        force = frame["imu"]["linear_acceleration"]
        np.testing.assert_array_equal(np.float32(force), episode.imu["specific_force"][k])
        turn = frame["imu"]["angular_velocity"]
        np.testing.assert_array_equal(np.float32(turn), episode.imu["angular_velocity"][k])


def test_the_annotation_and_the_description_say_what_there_is(dataset: Dataset, out: Path) -> None:
    for place, episode in enumerate(dataset):
        found = json.loads((out / "annotations" / f"{place:06d}.json").read_text())
        assert found["sequences"] == [f"{place:06d}_front", f"{place:06d}_wrist"]
        assert found["success"] is episode.success
        assert found["object_id"] == episode.columns["object_id"]
    info = yaml.safe_load((out / "dataset_info.yaml").read_text())
    assert info["episodes"] == len(dataset.committed)
    assert info["successes"] == int(dataset.column("success").sum())
    assert sum(info["splits"].values()) == info["episodes"]
    assert info["rates_hz"]["video"] == 10


def test_an_episode_without_an_attempt_has_two_frames_and_empty_tables(tmp_path: Path) -> None:
    config = small_config(video_hz=5)
    prepare_store(tmp_path / "store.zarr", config, JOINTS, 1, {})
    ZarrWriter(tmp_path / "store.zarr").write_block(0, [make_episode(config, 0, n_steps=0)])
    out = Dataset(tmp_path / "store.zarr").export("sequences", tmp_path / "out").path
    folder = out / "sequences" / "000000_front"
    frames = json.loads((folder / "metadata.json").read_text())
    assert [frame["what"] for frame in frames] == ["before", "after"]
    for name in FILES:
        assert len((folder / name / "data.csv").read_text().splitlines()) == 1
    synchronized = json.loads((folder / "sync_metadata.json").read_text())
    assert [frame["imu"] for frame in synchronized] == [None, None]
    kalibr = yaml.safe_load((folder / "calibration/imu_to_cam_extrinsics.yaml").read_text())
    assert "T_cam_imu" not in kalibr["cam0"]


def test_nan_is_an_empty_cell_and_each_number_is_read_back(tmp_path: Path) -> None:
    values = np.array([[0.1, np.nan], [-0.0, 1e-42], [3.4028235e38, 1 / 3]], np.float32)
    write_series(tmp_path / "a.csv", {"a,b": values, "c": np.array([1, 2, 3], np.uint8)})
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == "a,b,c"
    assert lines[1] == "0.1,,1"
    table = read_csv(tmp_path / "a.csv")
    found = np.stack([table["a"], table["b"]], axis=1).astype(np.float32)
    assert found.tobytes() == values.tobytes()
