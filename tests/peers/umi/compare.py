"""Compares what UMI reads with the store; rotations by way of SciPy."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grasp_factory.dataset.dataset import Dataset
from grasp_factory.writers.exporters.steps import steps_of

FORMAT = "diffusion_policy"
SETTINGS = {"names": "umi"}
GENERATE = ("--camera", "front", "--camera", "wrist")
CLOSE = 1e-6
"""m and rad: UMI's arrays are float32, and its sampler interpolates."""


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare images and the hand's poses; UMI's sampler makes the action of the poses."""
    seen = 0
    lines = (export / "grasp_factory_episodes.jsonl").read_text().splitlines()
    for line in map(json.loads, lines):
        place, episode = line["episode"], dataset[line["row"]]
        steps = steps_of(episode)
        pose, width = steps.streams["tcp_pose"], steps.streams["gripper_width"][:, None]
        start, end = (np.repeat(pose[k], len(pose), axis=0) for k in ([0], [-1]))
        robot = f"{place}/robot0"
        assert_poses(read[f"{robot}_eef_pos"], read[f"{robot}_eef_rot_axis_angle"], pose)
        for name, poses in (("start", start), ("end", end)):
            assert_poses(*np.split(read[f"{robot}_demo_{name}_pose"], [3], axis=1), poses)
        position, vector, action_width = np.split(read[f"{place}/action"][..., :7], [3, 6], axis=1)
        assert_poses(position, vector, pose)
        for found in (read[f"{robot}_gripper_width"], action_width):
            np.testing.assert_allclose(found, width, rtol=0, atol=CLOSE)
        seen += 4 * pose.size + 2 * width.size
        for number, frames in enumerate(steps.images.values()):
            images = read[f"{place}/camera{number}_rgb"]
            np.testing.assert_array_equal(images, frames)
            seen += images.size
    return seen


def assert_poses(position: NDArray[Any], vector: NDArray[Any], pose: NDArray[np.float32]) -> None:
    """Compare positions and axes times angles, (K, 3), with poses (K, 7), both in metres and rad.

    At half a turn an axis and its opposite are the same rotation.
    """
    np.testing.assert_allclose(position, pose[:, :3], rtol=0, atol=CLOSE)
    turn = Rotation.from_rotvec(vector) * Rotation.from_quat(pose[:, 3:]).inv()
    assert turn.magnitude().max() < CLOSE
