"""Compares what GG-CNN reads with the store: each grasp back in the world, and each image."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp_factory.core.camera import deproject_pixels
from grasp_factory.core.episode import Episode
from grasp_factory.core.geometry import Array, apply, inverse, quat_xyzw_to_matrix
from grasp_factory.dataset.dataset import Dataset
from grasp_factory.robots import ROBOTS

FORMAT = "jacquard"
SETTINGS: dict[str, Any] = {}
GENERATE = ("--camera", "overhead", "--policy", "top_down")
SIDE, INPUT, WIDEST = 1024, 300, 150
"""Pixels of the images, of the network's input, and of the widest grasp there, in GG-CNN."""


def compare(dataset: Dataset, export: Path, read: Mapping[str, NDArray[Any]]) -> int:
    """Compare all good grasps and their images; GG-CNN does not read the other episodes."""
    good = [(place, episode) for place, episode in enumerate(dataset) if episode.success]
    assert len(good) == int(read["count"]) > 0
    seen = 0
    for place, episode in good:
        mine = {key.split("/")[1]: value for key, value in read.items() if key[0] == str(place)}
        compare_grasp(dataset, episode, mine)
        for name in ("rgb", "depth"):
            image = getattr(episode.cameras["overhead"], name)[0]
            height, width = image.shape[:2]
            square = image[:, (width - height) // 2 : (width + height) // 2]
            centres = np.round((np.arange(height) + 0.5) * SIDE / height - 0.5).astype(int)
            found = mine[name][centres[:, None], centres]
            np.testing.assert_array_equal(found, square)
            seen += square.size
        seen += 5
    return seen


def compare_grasp(dataset: Dataset, episode: Episode, mine: Mapping[str, NDArray[Any]]) -> None:
    """Compare the rectangle's sides with the pads and their opening in the world, and the label."""
    first, second, third, _ = in_world(episode, mine["corners"])
    R = quat_xyzw_to_matrix(episode.columns["grasp_quat_xyzw"])
    opening, pad = episode.columns["grasp_width"], ROBOTS[dataset.config.robot].gripper.pad_size[0]
    closing = math.copysign(1.0, (second - first) @ R[:, 1]) * R[:, 1]
    np.testing.assert_allclose(second - first, closing * opening, atol=3e-4)
    assert abs(np.linalg.norm(third - second) - pad) < 3e-4
    centre = (first + third) / 2.0
    np.testing.assert_allclose(centre, episode.columns["grasp_position"], atol=3e-4)
    angle, length, _ = mine["grasp"]
    assert mine["shape"].tolist() == [4, INPUT, INPUT]
    wanted = [math.cos(2 * angle), math.sin(2 * angle), length * INPUT / SIDE / WIDEST]
    np.testing.assert_allclose(mine["label"], wanted, atol=0.15)
    middle = mine["corners"].mean(axis=0) * INPUT / SIDE
    assert np.linalg.norm(mine["good"].mean(axis=0) - middle) < 2.0


def in_world(episode: Episode, corners: NDArray[Any]) -> Array:
    """Return where corners (4, 2), row and column, are in the world at the TCP's depth, (4, 3)."""
    frames = episode.cameras["overhead"]
    height, width = frames.depth[0].shape
    T = frames.T_world_camera[0]
    depth = apply(inverse(T), episode.columns["grasp_position"])[2]
    rows, columns = ((corners + 0.5) * height / SIDE - 0.5).T
    at = deproject_pixels(
        columns + (width - height) / 2, rows, np.full(4, depth), frames.intrinsics
    )
    return apply(T, at)
