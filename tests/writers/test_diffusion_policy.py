"""`diffusion_policy`, read with zarr; `bin/check-exports` reads with the projects' own code."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from support.exporter_contract import make_store
from support.stored import varied

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.errors import ConfigError, UsageError
from grasp_factory.writers.exporters import base, replay_buffer_file
from grasp_factory.writers.exporters.diffusion_policy import rotation_vectors


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return Dataset(varied())


def exported(dataset: Dataset, out: Path, **settings: Any) -> zarr.Group:
    dataset.export("diffusion_policy", out, **settings)
    store = zarr.storage.ZipStore(out / "replay_buffer.zarr.zip", mode="r")
    return zarr.open_group(store, mode="r", zarr_format=2)


def records(dataset: Dataset) -> list[NDArray[np.int64]]:
    """Return for each episode the last record at or before each frame."""
    return [
        np.array([np.flatnonzero(e.streams["timestamp"] <= t)[-1] for t in e.videos["timestamp"]])
        for e in dataset
    ]


def assert_holds(buffer: zarr.Group, name: str, parts: list[NDArray[Any]]) -> None:
    """Check that an array has these values of the episodes, one after the other."""
    np.testing.assert_array_equal(buffer[f"data/{name}"], np.concatenate(parts), strict=True)


def test_every_array_is_read_back_at_the_video_rate(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay_buffer_file, "STEPS_PER_CHUNK", 10)
    monkeypatch.setattr(base, "EPISODES_PER_PART", 1)
    buffer = exported(dataset, tmp_path / "out")
    episodes, at = list(dataset), records(dataset)
    assert buffer["meta/episode_ends"].dtype == np.int64
    assert buffer["meta/episode_ends"][:].tolist() == np.cumsum([len(r) for r in at]).tolist()
    seen = {"state", "action", "reward", "video_timestamp"}
    for name in episodes[0].streams:
        if name != "reward":
            assert_holds(
                buffer, name, [e.streams[name][r] for e, r in zip(episodes, at, strict=True)]
            )
            seen.add(name)
    assert_holds(buffer, "video_timestamp", [e.videos["timestamp"] for e in episodes])
    for number, camera in enumerate(buffer.attrs["cameras"]):
        for what in ("rgb", "T_world_camera"):
            name = f"camera{number}_{what}"
            assert_holds(buffer, name, [e.videos[f"{camera}/{what}"] for e in episodes])
            seen.add(name)
    assert seen == set(buffer["data"].array_keys())
    measured, commanded, rewards = [], [], []
    for episode, record in zip(episodes, at, strict=True):
        s, after = episode.streams, [*record[1:], -1]
        measured.append(np.c_[s["joint_positions"], s["gripper_width"]][record])
        commanded.append(np.c_[s["joint_position_targets"], s["gripper_width_target"]][after])
        rewards.append(np.append(np.zeros(len(record) - 1), episode.success).astype(np.float32))
    assert_holds(buffer, "state", measured)
    assert_holds(buffer, "action", commanded)
    assert_holds(buffer, "reward", rewards)


def test_with_umis_names_there_are_the_hands_poses_and_no_action(
    dataset: Dataset, tmp_path: Path
) -> None:
    buffer = exported(dataset, tmp_path / "out", names="umi")
    data = buffer["data"]
    assert {"action", "state"}.isdisjoint(data.array_keys())
    poses = [e.streams["tcp_pose"][r] for e, r in zip(dataset, records(dataset), strict=True)]
    pose = np.concatenate(poses)
    np.testing.assert_array_equal(data["robot0_eef_pos"], pose[:, :3], strict=True)
    turned = Rotation.from_rotvec(data["robot0_eef_rot_axis_angle"][:])
    assert (turned * Rotation.from_quat(pose[:, 3:]).inv()).magnitude().max() < 1e-6
    assert_holds(buffer, "robot0_gripper_width", [data["gripper_width"][:][:, None]])
    start = 0
    for part in poses:
        for name, which in (("start", 0), ("end", -1)):
            found = data[f"robot0_demo_{name}_pose"][start : start + len(part)]
            assert found.dtype == np.float64
            np.testing.assert_allclose(found[:, :3], part[which][None, :3].repeat(len(part), 0))
            at = Rotation.from_rotvec(found[:, 3:])
            assert (at * Rotation.from_quat(part[which, 3:]).inv()).magnitude().max() < 1e-6
        start += len(part)


def test_a_rotation_vector_is_right_at_no_turn_and_at_half_a_turn() -> None:
    quats = np.array([[0.0, 0, 0, 1], [0, 0, 0, -1], [1e-9, 0, 0, 1], [0, 1, 0, 0], [0, 0, -1, 0]])
    found = rotation_vectors(quats)
    expected = [[0, 0, 0], [0, 0, 0], [2e-9, 0, 0], [0, np.pi, 0], [0, 0, -np.pi]]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_splits_and_successes_are_those_of_the_episodes(tmp_path: Path) -> None:
    buffer = exported(make_store(tmp_path / "store.zarr"), tmp_path / "out")
    lines = (tmp_path / "out/grasp_factory_episodes.jsonl").read_text().splitlines()
    columns = [json.loads(line)["columns"] for line in lines]
    splits = [buffer.attrs["splits"][code] for code in buffer["meta/episode_split"][:]]
    assert splits == [of["split"] for of in columns]
    assert set(splits) >= {"train", "val"}
    success = buffer["meta/episode_success"][:].tolist()
    assert success == [of["outcome"] == "success" for of in columns]


def test_the_files_are_those_that_zarr_of_2022_reads(dataset: Dataset, tmp_path: Path) -> None:
    exported(dataset, tmp_path / "out")
    with zipfile.ZipFile(tmp_path / "out/replay_buffer.zarr.zip") as file:
        names = file.namelist()
        assert not [name for name in names if name.endswith("zarr.json")]
        frames = [name for name in names if re.fullmatch(r"data/camera1_rgb/\d+\.0\.0\.0", name)]
        about = json.loads(file.read("data/camera1_rgb/.zarray"))
        assert all(info.date_time[0] == 1980 for info in file.infolist())
    assert (about["zarr_format"], about["chunks"]) == (2, [1, 72, 96, 3])
    assert about["compressor"] == {
        "id": "blosc",
        "cname": "zstd",
        "clevel": 1,
        "shuffle": 0,
        "blocksize": 0,
    }
    assert len(frames) == about["shape"][0]


def test_a_store_without_videos_is_refused_with_what_to_do(tmp_path: Path) -> None:
    dataset = make_store(tmp_path / "store.zarr", video_hz=0)
    with pytest.raises(UsageError, match=r"has no videos.*: generate .* with --video-hz 10"):
        dataset.export("diffusion_policy", tmp_path / "out")


def test_other_names_are_refused_with_the_valid_ones(dataset: Dataset, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"names: got 'robosuite', valid: diffusion_policy, umi"):
        dataset.export("diffusion_policy", tmp_path / "out", names="robosuite")
