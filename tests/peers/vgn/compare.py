"""Compares what VGN reads with the store, and the grids with those that Open3D makes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import quat_xyzw_to_matrix
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.robots import ROBOTS

FORMAT = "vgn"
SETTINGS: dict[str, Any] = {}
GENERATE = ("--camera", "front", "--camera", "overhead", "--camera", "wrist")
FIXED = ("front", "overhead")
SIZE, VOXELS = 0.3, 40


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare every episode whose grasp is in the cube."""
    seen = 0
    gripper = ROBOTS[dataset.config.robot].gripper
    np.testing.assert_allclose(read["setup"], [SIZE, gripper.max_width, SIZE / 6])
    for place, episode in enumerate(dataset):
        if f"{place}/grid" not in read:
            assert is_outside(episode) or np.isnan(episode.columns["grasp_position"]).any()
            continue
        mine = {key.split("/")[1]: value for key, value in read.items() if key[0] == str(place)}
        compare_grasp(episode, mine, gripper.tip_distance, gripper.max_width)
        for k, name in enumerate(FIXED):
            frames = episode.cameras[name]
            np.testing.assert_allclose(read["K"], frames.intrinsics)
            np.testing.assert_array_equal(mine["depth"][k], frames.depth[0])
            corner = np.linalg.inv(frames.T_world_camera[0]) @ [*origin(), 1.0]
            np.testing.assert_allclose(mine["extrinsics"][k, 4:], corner[:3], atol=1e-12)
            seen += frames.depth[0].size + 3
        compare_grids(mine["grid"], mine["open3d"])
        seen += mine["grid"].size + 16
    assert seen
    return seen


def origin() -> NDArray[Any]:
    """Return the cube's corner in the world, metres: about the default workspace."""
    return np.array([0.55 - SIZE / 2, -SIZE / 2, -SIZE / 6])


def is_outside(episode: Episode) -> bool:
    at = (episode.columns["grasp_position"] - origin()) / SIZE
    return bool(((at < 0.1) | (at > 0.9)).any())


def compare_grasp(
    episode: Episode, mine: Mapping[str, NDArray[Any]], tip_distance: float, widest: float
) -> None:
    """Compare the ends of VGN's fingers with the world, and both tables with each other."""
    columns = episode.columns
    R = quat_xyzw_to_matrix(columns["grasp_quat_xyzw"])
    np.testing.assert_allclose(mine["pose"][:3, :3], R, atol=1e-12)
    tips = columns["grasp_position"] + R[:, 2] * tip_distance - origin()
    np.testing.assert_allclose(mine["ends"].mean(axis=0), tips, atol=1e-9)
    first, second = mine["ends"]
    np.testing.assert_allclose(second - first, R[:, 1] * mine["width"], atol=1e-9)
    width = episode.streams["gripper_width"][-1] if episode.success else widest
    assert float(mine["width"]) == width
    assert int(mine["label"]) == int(mine["target"]) == episode.success
    voxel = SIZE / VOXELS
    assert mine["index"].tolist() == np.round(mine["pose"][:3, 3] / voxel).astype(int).tolist()
    assert float(mine["voxels"]) == np.float32(mine["width"] / voxel)
    about_approach = quat_xyzw_to_matrix(mine["rotations"][1])
    np.testing.assert_allclose(about_approach, R * [-1.0, -1.0, 1.0], atol=1e-6)


def compare_grids(found: NDArray[Any], other: NDArray[Any]) -> None:
    """Compare grids; a voxel on the edge of two pixels may take the other one."""
    assert found.shape == other.shape == (1, VOXELS, VOXELS, VOXELS)
    assert found.dtype == other.dtype == np.float32
    assert (other > 0.0).mean() > 0.05
    differ = np.abs(found - other) > 1e-4
    assert differ.mean() < 1e-3, f"{differ.mean():.2%} of the voxels differ"
